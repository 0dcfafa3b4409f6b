#pragma once

#include <string>
#include <vector>

#include "interflect/base/progress.h"

namespace interflect::cli {

/// A table as text, and whether every row of it is right.
struct StudyTable {
  std::string text;
  bool verified = true;
};

/// The study's first table (2014, Jacobi against BiCGSTAB to a relative residual of 1e-6 on four scenes) on our rooms
/// of the same sizes: iterations and median seconds per method, beside the study's own figures. F is in place; only the
/// solve is timed. Methods are interleaved, `repetitions` each. Every row is verified: converged, and within 1e-5 of
/// CG's answer. `rooms` names the folder with room-1312.obj and the others.
[[nodiscard]] StudyTable study_table(const std::string& rooms, const std::string& device, unsigned repetitions,
                                     ProgressSink& progress);

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
