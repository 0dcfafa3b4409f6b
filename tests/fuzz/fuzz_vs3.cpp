#include "fuzz_scene.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace interflect;
  return fuzzing::run(data, size, [](const std::string& text) { fuzzing::use(read_vs3(text, "fuzz.vs3")); });
}
