#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace interflect {

/// Rows [first, end) of F.
struct RowShare {
  std::uint32_t first = 0, end = 0;
  [[nodiscard]] bool has(std::uint32_t row) const { return row >= first && row < end; }
};

/// n rows dealt to so many ranks, in their order, as evenly as whole units of rows go; a rank may get none.
[[nodiscard]] inline std::vector<RowShare> row_shares(std::uint32_t n, std::uint32_t ranks, std::uint32_t unit) {
  const std::uint64_t units = (std::uint64_t{n} + unit - 1) / unit;
  const auto end = [&](std::uint64_t k) {
    return static_cast<std::uint32_t>(std::min<std::uint64_t>(n, units * k / ranks * unit));
  };
  std::vector<RowShare> out;
  for (std::uint32_t k = 0; k < ranks; ++k) out.push_back({end(k), end(k + 1)});
  return out;
}

/// The rank that has the row.
[[nodiscard]] inline std::uint32_t owner_of(const std::vector<RowShare>& shares, std::uint32_t row) {
  const auto found = std::upper_bound(shares.begin(), shares.end(), row,
                                      [](std::uint32_t r, const RowShare& share) { return r < share.end; });
  return static_cast<std::uint32_t>(found - shares.begin());
}

}  // namespace interflect
