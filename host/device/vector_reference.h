#pragma once

#include <cmath>
#include <string_view>
#include <vector>

#include "interflect/device/kernel_arguments.h"

// What the vector kernels compute, as serial loops in double that can be checked by eye. kernels/README.md gives the
// same loops.

namespace interflect::reference {

/// A result in double, and the sum of the absolute values of what went into it, to which a rounding error is relative:
/// of |a| + |b| for a sum, |a| |b| for a product, and the errors of both parts for a quotient.
struct Number {
  double value = 0;
  double magnitude = 0;
  bool written = false;  ///< by the kernel: what is not must keep its bits

  Number() = default;
  explicit Number(double v) : value(v), magnitude(std::abs(v)) {}
  Number(double v, double m) : value(v), magnitude(m) {}
};

inline Number operator+(Number a, Number b) {
  return {a.value + b.value, a.magnitude + b.magnitude};
}
inline Number operator-(Number a, Number b) {
  return {a.value - b.value, a.magnitude + b.magnitude};
}
inline Number operator*(Number a, Number b) {
  return {a.value * b.value, a.magnitude * b.magnitude};
}
inline Number operator/(Number a, Number b) {
  const double q = a.value / b.value;
  return {q, std::abs(q) * (a.magnitude / std::abs(a.value) + b.magnitude / std::abs(b.value))};
}

using Numbers = std::vector<Number>;

/// Runs the vector kernel `name` over its buffers in the contract's order, the sums buffer last. Throws an internal
/// Error for a name that is none.
void vector_kernel(std::string_view name, const VectorArguments& arguments, std::vector<Numbers>& buffers);

/// How many vectors stand before the sums buffer.
[[nodiscard]] std::size_t vectors_of(std::string_view name);

/// The roundings of the unluckiest term in any result of a vector kernel: kernels/README.md.
[[nodiscard]] std::uint64_t vector_roundings(const VectorArguments& arguments);

}  // namespace interflect::reference
