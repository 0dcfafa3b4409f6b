#pragma once

#include <cstdint>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/base/ranks.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/iff_file.h"
#include "interflect/formfactor/rank_store.h"
#include "interflect/formfactor/row_shares.h"

// F by several ranks, each with its own rows of it in memory and no others. All functions are collective.

namespace interflect {

/// What a rank has: F's rows of its share, and the report. Rank 0's report is that of one process, to the bit; the
/// others have row_sum and scaling of it.
struct RankFormFactors {
  FormFactors own;
  std::uint64_t bytes = 0;      ///< of all ranks' rows
  double nonzero_fraction = 0;  ///< of all n² elements
};

/// assemble() by ranks. The tiles of the upper triangle are made by runs of tile rows, dealt out in turn; each goes to
/// the owners of its rows and of its columns. S of a pair depends on the pair alone, so that every number of ranks has
/// the same S. Row sums, closure and certificate are rank 0's work, whose products S x all ranks share. With a store
/// its panels are taken from there and kept there, and its shares hold; options.panels is not used. The sources of
/// errors are agreed(); a store that asks for a stop ends with an interrupted Error.
[[nodiscard]] RankFormFactors assemble_rows(Ranks& ranks, const PatchMesh& mesh, const AssemblyOptions& options,
                                            RankStore* store = nullptr, ProgressSink* progress = nullptr);

/// read_form_factors() by ranks: each reads the panels of its share, which are whole panels.
[[nodiscard]] RankFormFactors read_rows(Ranks& ranks, const IffFile& file);
/// The same for a file of which only S is used: the closure is found anew, as assemble_rows() does it.
[[nodiscard]] RankFormFactors close_rows(Ranks& ranks, const PatchMesh& mesh, const AssemblyOptions& options,
                                         const IffFile& file, ProgressSink* progress = nullptr);

/// Throws a limit Error (AgreedError) where one rank's share does not fit the memory that it has.
void check_rank_memory(Ranks& ranks, std::uint32_t n, const RowShare& share, std::uint64_t limit);

}  // namespace interflect
