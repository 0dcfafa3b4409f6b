#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "interflect/base/progress.h"

namespace interflect::cli {

/// The study's tables as text and as data, and whether every row of them is right.
struct StudyTables {
  std::string text;
  nlohmann::ordered_json data;  ///< {rows: [as bench's], tables: {methods, jacobi, layout: [a record per room]}}
  bool verified = true;
};

/// The tables of the study of 2014 (its poster) on our rooms of the same sizes, beside the study's own figures: Jacobi
/// against BiCGSTAB to a relative residual of 1e-6; Jacobi by its plain loop, serial and OpenMP, and by our kernels
/// through OpenMP and CUDA, with CG's gain over the plain loop; the plain loop with AoS and with SoA vectors. Times are
/// medians of `repetitions` passes in turn; F is in place; only solves are timed. What is not verified is shown as
/// that. `rooms` names the folder with room-1312.obj and the others; `only`: their patch counts, all when empty.
[[nodiscard]] StudyTables study_tables(const std::string& rooms, const std::string& device, unsigned repetitions,
                                       const std::vector<unsigned>& only, ProgressSink& progress);

/// The folder with our own scenes: `given` if not empty, else the first of ./scenes, the source tree that this program
/// was built in, the installed share folder. Throws a usage Error when none has room-1312.obj.
[[nodiscard]] std::string scenes_folder(const std::string& given);

/// The rooms of the study's sizes and the area at which they have their patches.
struct Room {
  const char* file;
  unsigned patches;
  double divide;
};
[[nodiscard]] const std::vector<Room>& study_rooms();

[[nodiscard]] double median(std::vector<double> values);

}  // namespace interflect::cli
