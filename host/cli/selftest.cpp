#include "selftest.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "interflect/base/error.h"
#include "interflect/device/registry.h"
#include "pipeline.h"
#include "report.h"

namespace interflect::cli {

namespace {

constexpr Rgb reflectance{0.5, 0.25, 0.8};
constexpr Rgb emittance{1, 2, 0.5};

/// A unit cube whose fronts look inwards.
Scene furnace() {
  Scene scene;
  scene.materials.push_back({"wall", reflectance, emittance, false, -1, -1});
  scene.surfaces.push_back({"furnace", "", 0});
  for (int k = 0; k < 8; ++k) {
    scene.positions.push_back(
        {static_cast<double>(k & 1), static_cast<double>(k >> 1 & 1), static_cast<double>(k >> 2)});
  }
  // Each face by its corners, counter-clockwise from inside.
  constexpr std::uint32_t faces[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1},
                                         {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};
  for (const auto& f : faces) {
    scene.triangles.push_back({{f[0], f[1], f[2]}, 0, 0, -1});
    scene.triangles.push_back({{f[0], f[2], f[3]}, 0, 0, -1});
  }
  return scene;
}

double largest_error(const std::vector<Rgb>& radiosity) {
  double largest = 0;
  for (const Rgb& b : radiosity) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double error = std::abs(b[c] * (1 - reflectance[c]) / emittance[c] - 1);
      largest = error <= largest ? largest : error;  // also takes a NaN
    }
  }
  return largest;
}

}  // namespace

std::string selftest(const std::string& device) {
  constexpr double bound = 1e-4;
  try {
    SubdivideOptions subdivision;
    subdivision.divide = 1.0 / 64;
    const PatchMesh mesh = subdivide(furnace(), subdivision);
    const FormFactors factors = assemble(mesh);
    std::vector<std::unique_ptr<Device>> devices;
    devices.push_back(open_device(device));
    Scheduler scheduler(factors.matrix, std::move(devices), 3);
    for (const Method method : {Method::cg, Method::bicgstab, Method::jacobi}) {
      const Solved solved = solve_placed(scheduler, mesh, method, StopTest{});
      if (!solved.report.converged) return fmt::format("FAIL: {} did not converge", name(method));
      const double error = largest_error(solved.radiosity);
      if (!(error <= bound)) {
        return fmt::format("FAIL: {}: radiosity is off by {:.1e} (relative)", name(method), error);
      }
    }
    return "PASS";
  } catch (const Error& error) {
    return fmt::format("FAIL: {}", first_line(error.what()));
  }
}

}  // namespace interflect::cli
