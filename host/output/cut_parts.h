#pragma once

#include <optional>
#include <vector>

#include "interflect/output/walls.h"

namespace interflect {

/// The parts into which these feet cut a patch with edges b − a = `b` and c − a = `c`; nothing when they hardly matter:
/// all corners in one part that is nearly the whole patch, as under a table's leg.
[[nodiscard]] std::optional<Cut> cut_of(std::vector<Cut::Segment> walls, Vec3 b, Vec3 c);

}  // namespace interflect
