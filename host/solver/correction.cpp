#include "interflect/solver/correction.h"

#include <algorithm>

#include "interflect/base/error.h"

namespace interflect {

Correction::Correction(Scheduler& scheduler, const Columns& reflectance, const Columns& weight)
    : scheduler_(scheduler),
      bounce_(scheduler.kernel("bounce")),
      rho_(scheduler.vector()),
      weight_(scheduler.vector()),
      r_(scheduler.vector()),
      x_(scheduler.vector()),
      y_(scheduler.vector()),
      sums_(scheduler.sums()),
      head_(std::size_t{scheduler.columns()} * (scalar_slots + scheduler.blocks())),
      rr_(scheduler.columns()) {
  scheduler_.upload(rho_, reflectance);
  scheduler_.upload(weight_, weight);
}

void Correction::begin(const Columns& g, std::span<const float> target) {
  std::vector<float> slots(std::size_t{scheduler_.columns()} * scalar_slots);
  std::copy(target.begin(), target.end(), slots.begin() + std::ptrdiff_t{slot::target} * scheduler_.columns());
  scheduler_.upload(sums_, slots);
  scheduler_.upload(x_, std::vector<float>(std::size_t{scheduler_.columns()} * scheduler_.stride()));
  scheduler_.upload(r_, g);
  scheduler_.apply(r_, y_);
  first_step();
}

void Correction::first_step() {
  scheduler_.run(bounce_, {&y_, &rho_, &weight_, &r_, &x_, &sums_}, "r = rho F g");
}

std::span<const float> Correction::residuals() {
  scheduler_.download(sums_, head_);
  const std::uint32_t blocks = scheduler_.blocks();
  for (std::uint32_t c = 0; c < scheduler_.columns(); ++c) {
    const float* partial = head_.data() + std::size_t{scheduler_.columns()} * scalar_slots + std::size_t{c} * blocks;
    rr_[c] = 0;
    for (std::uint32_t block = 0; block < blocks; ++block) rr_[c] += partial[block];  // the kernels' own order
  }
  return rr_;
}

std::unique_ptr<Correction> make_correction(Method method, Scheduler& scheduler, const Columns& reflectance,
                                            const Columns& weight) {
  switch (method) {
    case Method::cg: return make_cg(scheduler, reflectance, weight);
    case Method::bicgstab: return make_bicgstab(scheduler, reflectance, weight);
    case Method::jacobi: return make_jacobi(scheduler, reflectance, weight);
  }
  throw Error(ErrorKind::internal, "unknown method");
}

}  // namespace interflect
