#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "interflect/schedule/scheduler.h"

// Products by a Scheduler, and how far they are off.

namespace interflect::test {

/// Columns of n positive values, each another.
inline Columns positive_wave(std::size_t n, std::size_t columns) {
  Columns x(columns, std::vector<float>(n));
  for (std::size_t c = 0; c < columns; ++c) {
    for (std::size_t i = 0; i < n; ++i) x[c][i] = 1.5F + std::cos(static_cast<float>(i + 11 * c));
  }
  return x;
}

/// F x as the devices have it.
inline Columns applied(Scheduler& scheduler, const Columns& x) {
  Vector in = scheduler.vector(), out = scheduler.vector();
  scheduler.upload(in, x);
  scheduler.apply(in, out);
  Columns y;
  scheduler.download(out, y);
  return y;
}

/// The largest |y − exact| / exact; all terms are positive.
inline double largest_error(const Columns& y, const std::vector<std::vector<double>>& exact) {
  double worst = 0;
  for (std::size_t c = 0; c < y.size(); ++c) {
    for (std::size_t i = 0; i < y[c].size(); ++i) {
      worst = std::max(worst, std::abs(static_cast<double>(y[c][i]) - exact[c][i]) / exact[c][i]);
    }
  }
  return worst;
}

}  // namespace interflect::test
