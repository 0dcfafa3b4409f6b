#include "frame_names.h"

#include <fmt/format.h>

#include <set>
#include <system_error>

#include "interflect/base/error.h"
#include "outputs.h"

namespace interflect::cli {

namespace {

constexpr int widest = 12;

/// The text with numbers put in; counts them.
std::string expand(const std::string& pattern, std::uint64_t k, int& numbers) {
  const auto refuse = [&](const std::string& cause) {
    return Error(ErrorKind::usage, fmt::format("-o {}: {}", pattern, cause));
  };
  std::string out;
  for (std::size_t at = 0; at < pattern.size(); ++at) {
    if (pattern[at] != '%') {
      out += pattern[at];
      continue;
    }
    if (at + 1 < pattern.size() && pattern[at + 1] == '%') {
      out += pattern[++at];
      continue;
    }
    int width = 0;
    std::size_t end = at + 1;
    const bool zeros = end < pattern.size() && pattern[end] == '0';
    for (; end < pattern.size() && pattern[end] >= '0' && pattern[end] <= '9' && width <= widest; ++end) {
      width = 10 * width + (pattern[end] - '0');
    }
    if (end >= pattern.size() || pattern[end] != 'd' || width > widest) {
      throw refuse("after a % comes d, as in %04d for the frame's number (or % again)");
    }
    out += zeros || width == 0 ? fmt::format("{:0{}}", k, width) : fmt::format("{:{}}", k, width);
    ++numbers;
    at = end;
  }
  return out;
}

}  // namespace

std::string frame_name(const std::string& pattern, std::uint64_t k) {
  int numbers = 0;
  return expand(pattern, k, numbers);
}

std::string as_pattern(const std::string& text) {
  std::string out;
  for (const char c : text) out += c == '%' ? "%%" : std::string(1, c);
  return out;
}

void check_frame_names(const std::vector<std::string>& patterns, bool several) {
  for (const std::string& pattern : patterns) {
    const auto refuse = [&](const std::string& cause) {
      throw Error(ErrorKind::usage, fmt::format("-o {}: {}", pattern, cause));
    };
    if (extension_of(pattern) != ".png" && extension_of(pattern) != ".exr") {
      refuse(fmt::format("'{}' is not a picture (.png, .exr)", extension_of(pattern)));
    }
    int numbers = 0;
    (void)expand(pattern, 0, numbers);
    if (numbers > 1) refuse("one number is enough");
    if (several && numbers == 0) refuse("several frames need a number in their name, as in frame-%04d.png");
  }
}

void check_frames_spare(const std::vector<std::string>& patterns, std::uint64_t first, std::uint64_t end,
                        const std::vector<std::filesystem::path>& files) {
  const auto whole = [](const std::filesystem::path& path) {
    std::error_code missing;
    return std::filesystem::weakly_canonical(std::filesystem::absolute(path, missing), missing).string();
  };
  std::set<std::string> inputs;
  for (const auto& file : files) inputs.insert(whole(file));
  for (const std::string& pattern : patterns) {
    for (std::uint64_t k = first; k < end; ++k) {
      const std::string name = frame_name(pattern, k);
      if (!inputs.contains(whole(name))) continue;
      throw Error(ErrorKind::usage, fmt::format("{} belongs to the scene: an output would destroy it", name));
    }
  }
}

}  // namespace interflect::cli
