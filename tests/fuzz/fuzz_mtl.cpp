#include "fuzz_scene.h"
#include "interflect/scene/obj_material.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace interflect;
  return fuzzing::run(data, size, [](const std::string& text) {
    MtlLibrary library;
    std::vector<std::string> warnings;
    read_mtl(text, "fuzz.mtl", library, warnings);
    for (const auto& [name, material] : library) {
      for (std::size_t c = 0; c < 3; ++c) {
        if (!std::isfinite(material.reflectance[c])) fuzzing::found("a reflectance that is not finite:", name.c_str());
        if (!std::isfinite(material.emittance[c])) fuzzing::found("an emittance that is not finite:", name.c_str());
      }
    }
  });
}
