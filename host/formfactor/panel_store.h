#pragma once

#include <cstdint>
#include <span>

#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect {

/// Keeps finished panels of S beyond this process. A panel is rows [k * rows_per_panel, ...) of S, whole rows, both
/// sides of the diagonal, dense32.
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
  /// A panel that is there: fills its rows of the matrix.
  [[nodiscard]] virtual TileFacts load(std::uint32_t panel, FormFactorMatrix& s) = 0;
  /// Keeps a panel from the matrix' rows. When this returns, has(panel) holds for every later process, whatever happens
  /// to this one. Throws an input Error when the disk is full; earlier panels stay usable.
  virtual void save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts& facts) = 0;
};

}  // namespace interflect
