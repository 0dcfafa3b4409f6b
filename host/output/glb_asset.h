#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace interflect {

/// The JSON chunk and the binary chunk of a GLB file as they grow together: one scene, one unlit material.
class GlbAsset {
 public:
  using Json = nlohmann::ordered_json;

  GlbAsset();

  [[nodiscard]] Json& json() { return json_; }
  [[nodiscard]] Json& scene() { return json_["scenes"][0]; }
  [[nodiscard]] Json& material() { return json_["materials"][0]; }

  /// An accessor over `Size` floats per element (2, 3 or 4); `bounds`: with min and max, as POSITION must have them.
  template <std::size_t Size>
  std::size_t add_vectors(const std::vector<std::array<float, Size>>& values, bool bounds = false);
  std::size_t add_indices(const std::vector<std::uint32_t>& values);
  /// A texture of an embedded PNG file, shown without mipmaps and without repetition.
  std::size_t add_texture(const std::string& name, const std::string& png);
  /// Appends to one of glTF's lists; the entry's index.
  std::size_t add(const char* list, Json entry);

  /// Throws a limit Error for more than 4 GiB, which GLB does not hold.
  void write(const std::filesystem::path& path);

 private:
  std::size_t add_view(std::size_t start, int target);

  Json json_;
  std::string binary_;
};

}  // namespace interflect
