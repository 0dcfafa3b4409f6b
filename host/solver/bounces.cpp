#include "interflect/solver/bounces.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "interflect/base/error.h"

namespace interflect {

namespace {

void check(const Scheduler& scheduler, const Columns& reflectance, const Columns& emittance) {
  bool right = !reflectance.empty() && !emittance.empty() && emittance.size() % reflectance.size() == 0;
  for (const Columns* columns : {&reflectance, &emittance}) {
    for (const auto& column : *columns) right = right && column.size() == scheduler.size();
  }
  if (!right) {
    throw Error(ErrorKind::usage, fmt::format("bounces: {} columns of reflectances and {} of emittances do not fit {} "
                                              "patches",
                                              reflectance.size(), emittance.size(), scheduler.size()));
  }
  const auto all = [](const Columns& columns, auto good) {
    return std::all_of(columns.begin(), columns.end(),
                       [&](const auto& column) { return std::all_of(column.begin(), column.end(), good); });
  };
  if (!all(reflectance, [](float v) { return v >= 0.0F && v <= 1.0F; })) {
    throw Error(ErrorKind::input, "bounces: a reflectance is not in [0, 1]");
  }
  if (!all(emittance, [](float v) { return std::isfinite(v); })) {
    throw Error(ErrorKind::input, "bounces: an emittance is not finite");
  }
}

/// Columns [first, first + columns) of the series.
class Batch {
 public:
  Batch(Scheduler& scheduler, const Columns& reflectance, const Columns& emittance, std::size_t first,
        std::uint32_t columns)
      : scheduler_(scheduler), first_(first), scale_(columns) {
    scheduler.use_columns(columns);
    rho_.resize(columns);
    e_.resize(columns);
    for (std::size_t c = 0; c < columns; ++c) {
      rho_[c] = reflectance[(first + c) % reflectance.size()];
      e_[c] = emittance[first + c];
      // The kernels' values are near 1: far from what they take for zero.
      for (const float v : e_[c]) scale_[c] = std::max(scale_[c], std::abs(v));
      for (float& v : e_[c]) v = scale_[c] > 0 ? v / scale_[c] : 0.0F;
    }
  }

  void run(std::vector<Columns>& series, ProgressSink* progress) {
    const VectorKernel bounce = scheduler_.kernel("bounce");
    Vector rho = scheduler_.vector(), d = scheduler_.vector(), r = scheduler_.vector(), x = scheduler_.vector(),
           y = scheduler_.vector(), sums = scheduler_.sums();
    scheduler_.upload(rho, rho_);
    scheduler_.upload(r, e_);
    scheduler_.upload(x, e_);
    Columns sum = e_;
    for (std::size_t k = 0; k < series.size(); ++k) {
      if (k > 0) {
        scheduler_.apply(r, y);
        // r = rho * y;  x += r
        scheduler_.run(bounce, {&y, &rho, &d, &r, &x, &sums}, "Bounce", 1);
        scheduler_.download(x, sum);
        if (progress != nullptr) progress->advance(1);
      }
      for (std::size_t c = 0; c < sum.size(); ++c) {
        std::vector<float>& out = series[k][first_ + c];
        out.resize(sum[c].size());
        for (std::size_t i = 0; i < out.size(); ++i) out[i] = sum[c][i] * scale_[c];
      }
    }
  }

 private:
  Scheduler& scheduler_;
  std::size_t first_;
  std::vector<float> scale_;  ///< that was taken out of a column
  Columns rho_, e_;
};

}  // namespace

std::vector<Columns> bounce_series(Scheduler& scheduler, const Columns& reflectance, const Columns& emittance,
                                   std::uint32_t count, ProgressSink* progress) {
  check(scheduler, reflectance, emittance);
  std::vector<Columns> series(std::size_t{count} + 1, Columns(emittance.size()));
  const std::size_t at_once = scheduler.most_columns();
  const std::size_t batches = (emittance.size() + at_once - 1) / at_once;
  if (progress != nullptr) progress->begin("Bounces", batches * count);
  for (std::size_t first = 0; first < emittance.size(); first += at_once) {
    const std::size_t columns = std::min(at_once, emittance.size() - first);
    Batch(scheduler, reflectance, emittance, first, static_cast<std::uint32_t>(columns)).run(series, progress);
  }
  if (progress != nullptr) progress->end();
  return series;
}

}  // namespace interflect
