#include "fuzz_scene.h"
#include "interflect/scene/png_texture.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace interflect;
  return fuzzing::run(data, size, [](const std::string& bytes) {
    const Image image = decode_png(bytes, "fuzz.png");
    if (image.pixels.size() != std::size_t{3} * image.width * image.height) fuzzing::found("an image of another size");
    for (const float v : image.pixels) {
      if (!(v >= 0 && v <= 1)) fuzzing::found("a texel outside [0, 1]");
    }
  });
}
