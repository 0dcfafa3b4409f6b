// What an iteration costs beside its product: a room-like F of N patches, each method to 1e-6, its products timed
// alone.
//
//   solver_bench [N [REPETITIONS]]        default 1312 and 9680, 9 repetitions

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "interflect/base/error.h"
#include "interflect/base/timer.h"
#include "interflect/base/vec3.h"
#include "interflect/device/registry.h"
#include "interflect/solver/solver.h"

namespace {

using namespace interflect;

/// The inside of a box, its six sides in cells, N patches: S_ij = A_i A_j cos cos / (π r²), some pairs blocked by a
/// plate across the middle that leaves half of it open, rows scaled to at most 1 alike so that S stays symmetric.
struct BoxRoom {
  explicit BoxRoom(std::uint32_t n) : form_factors(n), area(n) {
    std::vector<Vec3> centre(n), normal(n);
    const std::uint32_t per_side = (n + 5) / 6;
    const auto cells = static_cast<std::uint32_t>(std::ceil(std::sqrt(per_side)));
    for (std::uint32_t i = 0; i < n; ++i) {
      const std::uint32_t side = i / per_side, k = i % per_side;
      const double u = (k % cells + 0.5) / cells, v = (k / cells + 0.5) / cells, w = side % 2;  // NOLINT: whole cells
      const double inwards = side % 2 == 0 ? 1 : -1;
      centre[i] = side < 2 ? Vec3{w, u, v} : side < 4 ? Vec3{u, w, v} : Vec3{u, v, w};
      normal[i] = side < 2 ? Vec3{inwards, 0, 0} : side < 4 ? Vec3{0, inwards, 0} : Vec3{0, 0, inwards};
      area[i] = 1.0 / (cells * cells);
    }
#pragma omp parallel for schedule(static)
    for (std::uint32_t i = 0; i < n; ++i) {
      for (std::uint32_t j = 0; j < n; ++j) {
        const Vec3 d = centre[j] - centre[i];
        const double cosines = std::max(0.0, dot(normal[i], d)) * std::max(0.0, -dot(normal[j], d));
        const bool crosses = (centre[i].x - 0.5) * (centre[j].x - 0.5) < 0;
        const double z = centre[i].z + (centre[j].z - centre[i].z) * (0.5 - centre[i].x) / (crosses ? d.x : 1.0);
        const double r2 = dot(d, d);
        const bool blocked = crosses && z < 0.5;
        const double f = cosines > 0 && !blocked ? area[j] * cosines / (std::numbers::pi * r2 * r2) : 0.0;
        form_factors.row(i)[j] = static_cast<float>(std::min(f, 0.2));  // neighbours across an edge
      }
    }
    const std::vector<double> sums = form_factors.row_sums();
    const double largest = *std::max_element(sums.begin(), sums.end());
#pragma omp parallel for schedule(static)
    for (std::uint32_t i = 0; i < n; ++i) {
      for (float& f : form_factors.row(i)) f = static_cast<float>(static_cast<double>(f) / largest);
    }
  }
  FormFactorMatrix form_factors;
  std::vector<double> area;
};

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

void measure(std::uint32_t n, int repetitions) {
  const BoxRoom room(n);
  Columns rho(3, std::vector<float>(n)), e(3, std::vector<float>(n));
  for (std::uint32_t i = 0; i < n; ++i) {
    const bool lamp = i >= n - n / 50;
    for (std::size_t c = 0; c < 3; ++c) {
      rho[c][i] = lamp ? 0.0F : 0.9F - 0.1F * static_cast<float>((i + c) % 3);
      e[c][i] = lamp ? 10.0F : 0.0F;
    }
  }
  std::vector<std::unique_ptr<Device>> devices;
  devices.push_back(open_device("openmp"));
  Scheduler scheduler(room.form_factors, std::move(devices), 3);
  Vector x = scheduler.vector(), y = scheduler.vector();
  scheduler.upload(x, e);
  std::vector<double> product, exact;
  std::vector<std::vector<double>> wide;
  for (int k = 0; k < repetitions; ++k) {
    const Timer timer;
    for (int i = 0; i < 10; ++i) scheduler.apply(x, y);
    scheduler.wait();
    product.push_back(timer.seconds() / 10);
    const Timer exact_timer;
    scheduler.exact_product(e, wide);
    exact.push_back(exact_timer.seconds());
  }
  const double one = median(product);
  fmt::print("{} patches: product {:.1f} us, in double on the host {:.1f} us\n", n, 1e6 * one, 1e6 * median(exact));
  for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
    std::vector<double> per_iteration, whole;
    SolveReport report;
    for (int k = 0; k < repetitions; ++k) {
      Columns b;
      const SolveReport few = solve(scheduler, method, {.iterations = 2}, room.area, rho, e, b);
      const SolveReport many = solve(scheduler, method, {.iterations = 22}, room.area, rho, e, b);
      per_iteration.push_back((many.seconds - few.seconds) / 20);
      report = solve(scheduler, method, {}, room.area, rho, e, b);
      whole.push_back(report.seconds);
    }
    const double products = method == Method::bicgstab ? 2 : 1;
    fmt::print(
        "  {:<9} iteration {:9.1f} us, of it {:5.1f} % not the product; solve {:9.1f} us, {} iterations, {} "
        "products{}\n",
        name(method), 1e6 * median(per_iteration), 100 * (1 - products * one / median(per_iteration)),
        1e6 * median(whole), report.iterations, report.products, report.converged ? "" : ", NOT CONVERGED");
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    const int repetitions = argc > 2 ? std::atoi(argv[2]) : 9;
    if (repetitions < 1) throw Error(ErrorKind::usage, "solver_bench [N [REPETITIONS]]");
    if (argc > 1) {
      measure(static_cast<std::uint32_t>(std::strtoul(argv[1], nullptr, 10)), repetitions);
    } else {
      measure(1312, repetitions);
      measure(9680, repetitions);
    }
    return 0;
  } catch (const Error& error) {
    fmt::print(stderr, "{}\n", error.what());
    return exit_status(error.kind());
  }
}
