#include "interflect/device/kernel_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/device/embedded_kernels.h"

namespace interflect {

namespace {

std::string text_of(const std::string& path) {
  constexpr std::uintmax_t largest = 1 << 20;
  if (const char* folder = std::getenv("INTERFLECT_KERNEL_DIR"); folder != nullptr && *folder != '\0') {
    try {
      return read_file(std::filesystem::path(folder) / path, largest);
    } catch (const Error& error) {
      throw Error(ErrorKind::device, fmt::format("INTERFLECT_KERNEL_DIR: {}", error.what()));
    }
  }
  const auto all = embedded_kernels();
  const auto found = std::find_if(all.begin(), all.end(), [&](const EmbeddedKernel& k) { return k.path == path; });
  if (found == all.end())
    throw Error(ErrorKind::device, fmt::format("kernels/{}: no such kernel file is built in", path));
  return std::string(found->text);
}

/// The name between the quotes of an #include line; empty for any other.
std::string_view included(std::string_view line) {
  constexpr std::string_view directive = "#include \"";
  if (!line.starts_with(directive)) return {};
  const std::string_view rest = line.substr(directive.size());
  return rest.substr(0, rest.find('"'));
}

/// `path`: LANGUAGE/FILE. Names in it are relative to its folder.
void append(std::string& out, const std::string& path, std::set<std::string>& seen) {
  if (!seen.insert(path).second) return;
  const std::string text = text_of(path);
  out += fmt::format("#line 1 \"{}\"\n", path);
  std::size_t number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    const std::string_view line = std::string_view(text).substr(begin, end - begin);
    begin = end + 1;
    ++number;
    if (const std::string_view other = included(line); !other.empty()) {
      append(out, (std::filesystem::path(path).parent_path() / other).lexically_normal().generic_string(), seen);
      out += fmt::format("#line {} \"{}\"\n", number + 1, path);
    } else {
      out += line;
      out += '\n';
    }
  }
}

}  // namespace

std::string kernel_source(std::string_view language, std::string_view file) {
  std::string out;
  std::set<std::string> seen;
  append(out, fmt::format("{}/{}", language, file), seen);
  return out;
}

}  // namespace interflect
