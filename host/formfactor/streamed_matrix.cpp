#include "interflect/formfactor/streamed_matrix.h"

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"
#include "interflect/formfactor/simd.h"

namespace interflect {

StreamedMatrix::StreamedMatrix(const ExchangePanels& panels, std::span<const double> area,
                               std::span<const double> scaling, std::uint64_t memory)
    : stream_(panels, memory), in_(panels.size()), out_(panels.size()) {
  if (area.size() != panels.size() || scaling.size() != panels.size()) {
    throw Error(ErrorKind::internal, "streamed form factors: areas or scaling of another number of patches");
  }
  for (std::size_t i = 0; i < in_.size(); ++i) {
    in_[i] = static_cast<float>(scaling[i]);
    out_[i] = area[i] > 0 ? static_cast<float>(scaling[i] / area[i]) : 0.0F;
  }
}

ExchangeProduct exchange_product(PanelStream& stream) {
  return [&stream](const std::vector<float>& x) {
    const std::uint32_t n = stream.panels().size(), stride = stream.panels().stride();
    std::vector<double> y(n);
    stream.pass([&](const PanelStream::View& view) {
#pragma omp parallel for schedule(static)
      for (std::uint32_t r = 0; r < view.rows; ++r) y[view.first + r] = simd::dot(view.row(r, stride).first(n), x);
    });
    return y;
  };
}

double largest_change(PanelStream& stream, const std::vector<double>& d) {
  double largest = 0;
  if (std::all_of(d.begin(), d.end(), [](double v) { return v == 1.0; })) return largest;
  const std::uint32_t n = stream.panels().size(), stride = stream.panels().stride();
  const std::vector<float> x(d.begin(), d.end());
  stream.pass([&](const PanelStream::View& view) {
#pragma omp parallel for schedule(static) reduction(max : largest)
    for (std::uint32_t r = 0; r < view.rows; ++r) {
      const std::span<const float> row = view.row(r, stride).first(n);
      float low = x[0], high = x[0];
      bool any = false;
      for (std::uint32_t j = 0; j < n; ++j) {
        if (row[j] == 0.0F) continue;
        low = any ? std::min(low, x[j]) : x[j];
        high = any ? std::max(high, x[j]) : x[j];
        any = true;
      }
      const double di = d[view.first + r];
      if (any) {
        largest = std::max(
            {largest, std::abs(di * static_cast<double>(low) - 1), std::abs(di * static_cast<double>(high) - 1)});
      }
    }
  });
  return largest;
}

}  // namespace interflect
