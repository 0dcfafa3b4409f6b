#pragma once

#include <cstdint>
#include <span>

#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Keeps finished panels of S beyond this process. A panel is rows [k * rows_per_panel, ...) of S, whole rows, both
/// sides of the diagonal, dense32. A matrix that is given holds at least the rows of that panel (see rows_only()).
class PanelStore {
 public:
  PanelStore() = default;
  PanelStore(const PanelStore&) = delete;
  PanelStore& operator=(const PanelStore&) = delete;
  virtual ~PanelStore() = default;

  /// A multiple of PatchTable::block.
  [[nodiscard]] virtual std::uint32_t rows_per_panel() const = 0;
  /// Whether a panel is there, whole and undamaged.
  [[nodiscard]] virtual bool has(std::uint32_t panel) const = 0;
  /// Columns [first, first + columns) of the rows of a panel that is there, one row after the other: the padding up to
  /// the matrix' stride may be among them. Throws an input Error when it cannot be read.
  virtual void read_columns(std::uint32_t panel, std::uint32_t first, std::uint32_t columns,
                            std::span<float> to) const = 0;
  /// A panel that is there: fills its rows of the matrix.
  [[nodiscard]] virtual TileFacts load(std::uint32_t panel, FormFactorMatrix& s) = 0;
  /// Called before a panel is computed: finds out early that there is no room for it. Throws as save().
  virtual void prepare(std::uint32_t panel) { static_cast<void>(panel); }
  /// Keeps a panel from the matrix' rows. When this returns for the next panel (or throws), has(panel) holds for every
  /// later process, whatever happens to this one. Throws a limit Error when the disk is full, for this panel or the one
  /// before; what is kept stays usable.
  virtual void save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts& facts) = 0;
};

}  // namespace interflect
