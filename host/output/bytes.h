#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

namespace interflect {

/// Appends the bytes of a number in little-endian order, whatever the machine's order is.
template <class T>
void append_little_endian(std::string& out, T value) {
  auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if constexpr (std::endian::native == std::endian::big) std::reverse(bytes.begin(), bytes.end());
  out.append(bytes.data(), bytes.size());
}

/// The nearest float, the largest one where a double is beyond it.
inline float finite_float(double value) {
  constexpr double largest = std::numeric_limits<float>::max();
  return static_cast<float>(std::clamp(value, -largest, largest));
}

/// A name as a field of a line: control characters become spaces, bytes that are not UTF-8 become U+FFFD.
[[nodiscard]] std::string printable_name(std::string_view name);

/// The start of a NumPy file (format version 1.0) of little-endian float32 in rows: `shape` as Python writes the tuple.
[[nodiscard]] std::string npy_header(const std::string& shape);

}  // namespace interflect
