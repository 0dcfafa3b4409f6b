#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "interflect/base/progress.h"
#include "solver/reference.h"
#include "solver/room.h"

// A small room with a lamp and its solution in double, and who listens to a solve of it.

namespace interflect::test {

struct LitRoom {
  explicit LitRoom(float reflectance)
      : light(lamp_light(room, reflectance)),
        solution(reference_solution(room.form_factors, light.reflectance, light.emittance)) {}
  Room room = make_room(3, 2);
  Light light;
  Doubles solution;
};

/// Whether every column is within `bound` of the exact one, relative to its maximum.
inline bool right(const Columns& b, const Doubles& exact, double bound) {
  for (std::size_t c = 0; c < exact.size(); ++c) {
    if (!(relative_to_maximum(b.at(c), exact[c]) < bound)) return false;
  }
  return true;
}

/// Keeps the messages.
struct Messages final : ProgressSink {
  void message(std::string_view line) override { lines.emplace_back(line); }
  std::vector<std::string> lines;
};

}  // namespace interflect::test
