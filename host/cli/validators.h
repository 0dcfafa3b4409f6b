#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <limits>
#include <string>

#include "interflect/base/error.h"
#include "interflect/base/memory.h"

namespace interflect::cli {

/// A finite number above `above` and at most `most`. CLI11's own checks let NaN and wrapped negative numbers through.
template <typename T>
[[nodiscard]] CLI::Validator number(T above, T most = std::numeric_limits<T>::max()) {
  return CLI::Validator(
      [above, most](std::string& text) {
        T value{};
        const char* const end = text.data() + text.size();
        const auto [next, status] = std::from_chars(text.data(), end, value);
        if (status == std::errc{} && next == end && value > above && value <= most) return std::string{};
        return fmt::format("'{}' is not a number above {}{}", text, above,
                           most == std::numeric_limits<T>::max() ? "" : fmt::format(" and at most {}", most));
      },
      "NUMBER");
}

/// The name of a file to write.
[[nodiscard]] inline CLI::Validator file_name() {
  return CLI::Validator([](std::string& text) { return text.empty() ? "a file name is needed" : ""; }, "FILE");
}

/// A count from 0 to `most`.
[[nodiscard]] inline CLI::Validator count(std::uint32_t most) {
  return CLI::Validator(
      [most](std::string& text) {
        std::uint32_t value = 0;
        const char* const end = text.data() + text.size();
        const auto [next, status] = std::from_chars(text.data(), end, value);
        if (status == std::errc{} && next == end && value <= most) return std::string{};
        return fmt::format("'{}' is not a count from 0 to {}", text, most);
      },
      "COUNT");
}

/// A whole number of up to 64 bits. CLI11 itself would take "-1" for a large one.
[[nodiscard]] inline CLI::Validator whole_number() {
  return CLI::Validator(
      [](std::string& text) {
        std::uint64_t value = 0;
        const char* const end = text.data() + text.size();
        const auto [next, status] = std::from_chars(text.data(), end, value);
        if (status == std::errc{} && next == end) return std::string{};
        return fmt::format("'{}' is not a whole number from 0 to {}", text, std::numeric_limits<std::uint64_t>::max());
      },
      "NUMBER");
}

/// What parse_bytes() takes.
[[nodiscard]] inline CLI::Validator byte_size() {
  return CLI::Validator(
      [](std::string& text) {
        try {
          static_cast<void>(parse_bytes(text, ""));
          return std::string{};
        } catch (const Error&) {
          return fmt::format("'{}' is not a size such as 4G", text);
        }
      },
      "SIZE");
}

}  // namespace interflect::cli
