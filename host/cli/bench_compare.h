#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench_row.h"

namespace interflect::cli {

enum class Change { same, slower, faster, only_old, only_new, not_judged };
[[nodiscard]] std::string_view name(Change change);

/// A row of one run beside the row of the same device, what, scene, storage, n and columns of another.
struct Compared {
  const BenchRow* before = nullptr;  ///< null: only in the new run
  const BenchRow* after = nullptr;   ///< null: only in the old one
  Change change = Change::same;
  /// New median over old; 0 where one of them is missing.
  [[nodiscard]] double ratio() const;
};

/// The share of the old median below which a difference is never more than noise: two runs are not of the same seconds,
/// and a clock or a neighbour on the machine moves a median by that much without showing in either run's spread.
inline constexpr double least_change = 0.03;

/// Slower or faster when the medians differ by more than the sum of both interquartile ranges, and by more than
/// least_change of the old median. not_judged: a row of fewer than two passes, or one that was not verified.
[[nodiscard]] Change judge(const BenchRow& before, const BenchRow& after);

/// All rows of both, in the new one's order, then those that only the old one has. Points into both.
[[nodiscard]] std::vector<Compared> compare(const std::vector<BenchRow>& before, const std::vector<BenchRow>& after);

/// The table, and a last line with the counts.
[[nodiscard]] std::string compare_text(const std::vector<Compared>& rows);
[[nodiscard]] nlohmann::ordered_json compare_json(const std::vector<Compared>& rows);

}  // namespace interflect::cli
