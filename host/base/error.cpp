#include "interflect/base/error.h"

#include <fmt/format.h>

namespace interflect {

namespace {

/// Text of a file quoted in a message: control characters become '?', and a long text is cut.
std::string printable(std::string_view text) {
  constexpr std::size_t longest = 400;
  std::string out(text.substr(0, longest));
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  if (text.size() > longest) out += "...";
  return out;
}

}  // namespace

int exit_status(ErrorKind kind) noexcept {
  switch (kind) {
    case ErrorKind::internal: return 1;
    case ErrorKind::usage: return 2;
    case ErrorKind::input: return 3;
    case ErrorKind::device: return 4;
    case ErrorKind::not_converged: return 5;
    case ErrorKind::limit: return 6;
    case ErrorKind::interrupted: return 130;
  }
  return 1;
}

Error input_error(std::string_view file, std::size_t line, std::string_view cause) {
  const std::string place = line == 0 ? printable(file) : fmt::format("{}:{}", printable(file), line);
  return {ErrorKind::input, fmt::format("{}: {}", place, printable(cause))};
}

Error device_error(std::string_view device, std::string_view operation, std::string_view cause) {
  return {ErrorKind::device, fmt::format("{}: {}: {}", printable(device), printable(operation), printable(cause))};
}

}  // namespace interflect
