#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace interflect::cli {

/// In lower case, with its point.
[[nodiscard]] std::string extension_of(const std::string& path);
/// One and the same file, however it is spelled.
[[nodiscard]] bool same_file(const std::string& a, const std::string& b);

/// Everything about files to be written that can be wrong before the work starts. Throws a usage Error for one that is
/// `scene` or named twice, and what AtomicFile throws for one that cannot be written.
void check_files(const std::vector<std::string>& files, const std::string& scene);

/// What the scene is made of (materials, textures, buffers) is known once it is read. Throws a usage Error for an
/// output that is one of these files.
void check_inputs_stay(const std::vector<std::string>& outputs, const std::vector<std::filesystem::path>& inputs);

}  // namespace interflect::cli
