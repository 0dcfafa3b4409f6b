#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "interflect/formfactor/closure.h"
#include "interflect/formfactor/panel_store.h"
#include "interflect/formfactor/panel_stream.h"

namespace interflect {

/// The form factors F_ij = S_ij (d_i / A_i) d_j over panels of S that need not be in memory: F itself is never made.
/// Knows no device. One thread at a time may use it.
class StreamedMatrix {
 public:
  /// `memory` as in PanelStream. `scaling` is the closure's d, one per patch as `area`. The panels must outlive this.
  /// Throws a limit Error where not even two panels fit, and an internal Error for other than n areas and d.
  StreamedMatrix(const ExchangePanels& panels, std::span<const double> area, std::span<const double> scaling,
                 std::uint64_t memory);

  [[nodiscard]] std::uint32_t size() const { return stream_.panels().size(); }
  [[nodiscard]] std::uint32_t stride() const { return stream_.panels().stride(); }
  [[nodiscard]] std::uint64_t bytes() const { return stream_.bytes(); }  ///< of S
  /// y = t ∘ (S (s ∘ x)): s = d and t = d / A, 0 where the area is.
  [[nodiscard]] std::span<const float> scale_in() const { return in_; }
  [[nodiscard]] std::span<const float> scale_out() const { return out_; }
  /// Use of the panels: a pass changes what is in memory, never a result.
  [[nodiscard]] PanelStream& stream() const { return stream_; }

 private:
  mutable PanelStream stream_;
  std::vector<float> in_, out_;
};

/// S x, one pass for each. The stream must outlive what is returned. The same bits as from a matrix in memory.
[[nodiscard]] ExchangeProduct exchange_product(PanelStream& stream);

/// Scaling::max_change of the nonzero S_ij: a pass, unless d is 1 everywhere.
[[nodiscard]] double largest_change(PanelStream& stream, const std::vector<double>& d);

}  // namespace interflect
