#pragma once

#include <cstdint>
#include <vector>

#include "interflect/schedule/columns.h"

namespace interflect {

/// How far a solve has come, column by column. Knows nothing of devices: any of them, and any number of them, can go on
/// from it.
struct Iterate {
  Columns b;                        ///< a column that is not begun is 0
  std::vector<std::uint32_t> made;  ///< the iterations that each column is made of
  // Spent on it so far.
  std::uint32_t products = 0, passes = 0, restarts = 0;
  double seconds = 0;

  /// Of the column that has most.
  [[nodiscard]] std::uint32_t iterations() const;
};

/// Where a solve keeps its iterate for a later run of the program, and where it begins.
class IterateKeeper {
 public:
  IterateKeeper() = default;
  IterateKeeper(const IterateKeeper&) = delete;
  IterateKeeper& operator=(const IterateKeeper&) = delete;
  virtual ~IterateKeeper() = default;

  /// What an earlier run has kept; null: nothing, the solve begins at 0.
  [[nodiscard]] virtual const Iterate* found() const = 0;
  /// Seconds of iterating between two looks at due(), at most. Each costs a download of a vector.
  [[nodiscard]] virtual double interval() const = 0;
  /// Whether it is time to keep another one.
  [[nodiscard]] virtual bool due() = 0;
  /// Keeps it. A failure to do so is the keeper's to tell: it must not end the solve.
  virtual void keep(const Iterate& iterate) noexcept = 0;
};

}  // namespace interflect
