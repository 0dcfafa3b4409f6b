#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/scene/scene.h"

namespace interflect {

/// A material of an MTL file.
struct MtlMaterial {
  Rgb reflectance{};              ///< Kd
  Rgb emittance{};                ///< Ke
  std::string reflectance_image;  ///< map_Kd as it stands there
  std::string emittance_image;    ///< map_Ke
  std::filesystem::path folder;   ///< where the images are looked for
};
using MtlLibrary = std::map<std::string, MtlMaterial, std::less<>>;

/// What surfaces reflect of which the files say nothing.
inline constexpr double default_reflectance = 0.5;

/// Reads an MTL text into `library`; a name that is there already keeps its first meaning. Kd is the reflectance, Ke
/// the emittance; one number stands for three. Without Kd: 1 with map_Kd, 0 with Ke, else default_reflectance and a
/// warning. Without Ke: 1 with map_Ke, else 0. Throws an input Error with file and line for a colour that is not finite
/// numbers.
void read_mtl(std::string_view text, const std::filesystem::path& path, MtlLibrary& library,
              std::vector<std::string>& warnings);

/// Reads the image into scene.images unless it is there already, as told by `seen` (name to index). Returns its index,
/// or -1 with a warning when the file is missing or no PNG. Throws an input Error for a damaged PNG.
int load_texture(const MtlMaterial& material, const std::string& name, std::map<std::string, int>& seen, Scene& scene);

/// `name` as the file says it, relative to `folder`; with "\" taken for "/" when only that exists. Empty when there is
/// no such regular file.
[[nodiscard]] std::filesystem::path find_beside(const std::filesystem::path& folder, std::string_view name);

/// Adds a warning; those beyond the 50th are counted in the last line only.
void add_warning(std::vector<std::string>& warnings, std::string line);

}  // namespace interflect
