#pragma once

#include "interflect/base/progress.h"
#include "interflect/formfactor/assembly.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/panel_store.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// S of the rows that the matrix has, panel by panel when there is a store: what it has is taken from it, the rest is
/// made and kept in it. Of a matrix of some rows only (FormFactorMatrix::rows_only, whole panels of the store) the
/// columns before them come from the store, which has those panels already. The facts of the tiles are added to the
/// report. Throws what maker and store throw.
void fill(FormFactorMatrix& s, TileMaker& maker, PanelStore* panels, AssemblyReport& report, ProgressSink& progress);

/// S of all patches in the store, with at most `memory` bytes of rows in memory at a time. The same bits as by fill()
/// of the whole matrix. Throws a limit Error where two panels do not fit.
void fill_store(std::uint32_t n, TileMaker& maker, PanelStore& panels, std::uint64_t memory, AssemblyReport& report,
                ProgressSink& progress);

}  // namespace interflect
