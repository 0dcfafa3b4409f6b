#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/schedule/scheduler.h"
#include "interflect/solver/iterate.h"
#include "interflect/solver/solver.h"

namespace interflect {

/// solve() for any number of columns, as light groups make them: as many at once as the Scheduler was made with
/// (most_columns() of columns.h go through one pass over F), one batch after the other. Knows which batches are done
/// and how far the others have come, so that another device can go on.
class BatchedSolve {
 public:
  /// Columns as solve() takes them; of `reflectance` there may be fewer, which are then used over and over: column c of
  /// the emittances has reflectance c % reflectance.size(). What is given must outlive this. `interval` as in
  /// Checkpoint.
  BatchedSolve(Method method, const StopTest& stop, std::span<const double> area, const Columns& reflectance,
               const Columns& emittance, double interval = 1.0);

  /// Where the solve begins instead of at 0: a column for each of `emittance`, such as the last solution of a problem
  /// that has changed a little since (Checkpoint). Before the first run(). Throws a usage Error for another number of
  /// columns.
  void begin_at(Columns guess);

  /// Begins at what the keeper has found, and keeps its iterates there: within a pass and after it when they are due,
  /// and in any case what run() ends with, also where it throws. The keeper must outlive this. Before the first run().
  /// Throws a usage Error for another number of columns.
  void keep_in(IterateKeeper& keeper);

  /// Solves what is not solved yet and leaves the Scheduler with the columns of the last batch. Throws what solve()
  /// throws; what was done until then is kept, also where the next Scheduler takes fewer columns.
  void run(Scheduler& scheduler, ProgressSink* progress = nullptr);
  /// Forgets which batches are done, so that run() does them again.
  void begin_anew();

  /// Of all batches: iterations and passes of the one that took most, products and seconds together.
  [[nodiscard]] SolveReport report() const;
  /// Iterations that are in what run() has kept, times their columns; a batch that is done counts one more.
  [[nodiscard]] std::uint64_t kept_iterations() const;
  [[nodiscard]] Columns& radiosity() { return radiosity_; }

 private:
  struct Batch {
    std::size_t first = 0, columns = 0;
    Checkpoint checkpoint = {};
    std::optional<SolveReport> done = {};
    std::uint32_t made = 0;  ///< iterations in what it has come to
  };
  /// How far one batch is while it is solved.
  struct Moment {
    const Batch* batch = nullptr;
    const Columns* b = nullptr;
    const SolveReport* spent = nullptr;
  };
  void cut(std::uint32_t most);
  void begin_at(const Iterate& iterate);
  void run(Batch& batch, Scheduler& scheduler, ProgressSink* progress);
  [[nodiscard]] Iterate iterate(const Moment& now) const;

  Method method_;
  const StopTest& stop_;
  std::span<const double> area_;
  const Columns& reflectance_;
  const Columns& emittance_;
  std::vector<Batch> batches_;
  Columns radiosity_;
  IterateKeeper* keeper_ = nullptr;
};

}  // namespace interflect
