#include "outputs.h"

#include <fmt/format.h>

#include <filesystem>

#include "interflect/base/error.h"
#include "interflect/base/file.h"

namespace interflect::cli {

std::string extension_of(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

bool same_file(const std::string& a, const std::string& b) {
  std::error_code missing;
  if (std::filesystem::equivalent(a, b, missing)) return true;
  const auto whole = [&](const std::string& path) {
    return std::filesystem::weakly_canonical(std::filesystem::absolute(path, missing), missing);
  };
  return whole(a) == whole(b);
}

void check_files(const std::vector<std::string>& files, const std::string& scene) {
  for (std::size_t k = 0; k < files.size(); ++k) {
    if (same_file(files[k], scene)) {
      throw Error(ErrorKind::usage, fmt::format("{} is the scene: an output would destroy it", files[k]));
    }
    for (std::size_t earlier = 0; earlier < k; ++earlier) {
      if (!same_file(files[k], files[earlier])) continue;
      throw Error(ErrorKind::usage, fmt::format("{} is named twice as an output", files[k]));
    }
    const AtomicFile probe(files[k]);  // the folder is there and can be written to
  }
}

void check_inputs_stay(const std::vector<std::string>& outputs, const std::vector<std::filesystem::path>& inputs) {
  for (const std::string& output : outputs) {
    for (const std::filesystem::path& input : inputs) {
      if (!same_file(output, input.string())) continue;
      throw Error(ErrorKind::usage, fmt::format("{} belongs to the scene: an output would destroy it", output));
    }
  }
}

}  // namespace interflect::cli
