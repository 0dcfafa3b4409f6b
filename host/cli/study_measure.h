#pragma once

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/progress.h"
#include "interflect/schedule/scheduler.h"
#include "measurement.h"
#include "study.h"

namespace interflect::cli {

/// A room of the study, measured: solves to 1e-6 by our kernels and by the study's plain loop, F in place, all in turn,
/// pass by pass.
struct StudyRoom {
  std::string scene;
  std::uint32_t patches = 0;
  double form_factor_seconds = 0;
  /// Rows "solve:METHOD" of devices with dense32, "solve:cg:FORMAT" with F in 16 bits, and of device "host"
  /// "study:aos-serial", "study:aos-openmp", "study:soa-serial", "study:soa-openmp". A device that is not there has
  /// rows that say so.
  std::vector<Measurement> all;
  std::map<std::string, std::uint32_t> iterations;  ///< by key()

  static std::string key(std::string_view device, std::string_view what) {
    return std::string(device) + ' ' + std::string(what);
  }
  /// The row of CG that is the fastest of all formats on that device.
  [[nodiscard]] std::string best_cg(const std::string& device) const;
  /// The measurement when it passed, else null.
  [[nodiscard]] const Measurement* passed(std::string_view device, std::string_view what) const;
};

/// Measures one: all three methods and CG with each format on `device`, Jacobi and CG on openmp and on cuda:0, the four
/// plain loops. Each is verified: converged, and within 1e-5 of the largest radiosity of the answer that CG has on
/// `device` with dense32; within 1e-4 where F is rounded to 16 bits.
[[nodiscard]] StudyRoom measure_study_room(const std::string& folder, const Room& room, const std::string& device,
                                           unsigned repetitions, ProgressSink& progress);

/// The largest |a − b| of two solutions of N x 3 over the largest |b|; not a number when one holds such.
[[nodiscard]] double largest_difference(const Columns& a, const Columns& b);

}  // namespace interflect::cli
