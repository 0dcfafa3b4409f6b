#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <utility>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/formfactor/form_factor_matrix.h"
#include "interflect/schedule/scheduler.h"

namespace interflect::test {

/// A patch of the test room: a small rectangle on a wall or on a box that stands in the room.
struct RoomPatch {
  Vec3 centre, normal;
  double area = 0;
  int surface = 0;  ///< 0..5 the walls (x-, x+, y-, y+, z-, z+), 6.. the boxes' sides
};

struct Box {
  Vec3 low, high;
};

/// True when the segment from a to b passes through the inside of the box.
inline bool blocked(const Box& box, Vec3 a, Vec3 b) {
  double enter = 1e-9, leave = 1 - 1e-9;
  const Vec3 d = b - a;
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(d[axis]) < 1e-12) {
      if (a[axis] <= box.low[axis] + 1e-9 || a[axis] >= box.high[axis] - 1e-9) return false;
      continue;
    }
    double t0 = (box.low[axis] - a[axis]) / d[axis], t1 = (box.high[axis] - a[axis]) / d[axis];
    if (t0 > t1) std::swap(t0, t1);
    enter = std::max(enter, t0);
    leave = std::min(leave, t1);
  }
  return leave - enter > 1e-9;
}

/// The six sides of a box in cells x cells rectangles each; normals point inwards for a room, outwards for a thing in
/// it.
inline void add_sides(std::vector<RoomPatch>& patches, const Box& box, int cells, bool inwards, int first_surface) {
  const std::array low{box.low.x, box.low.y, box.low.z};
  const std::array high{box.high.x, box.high.y, box.high.z};
  for (std::size_t side = 0; side < 6; ++side) {
    const std::size_t axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
    const bool upper = side % 2 == 1;
    for (int i = 0; i < cells; ++i) {
      for (int j = 0; j < cells; ++j) {
        std::array<double, 3> c{}, n{};
        c[axis] = upper ? high[axis] : low[axis];
        c[u] = low[u] + (high[u] - low[u]) * (i + 0.5) / cells;
        c[v] = low[v] + (high[v] - low[v]) * (j + 0.5) / cells;
        n[axis] = upper == inwards ? -1 : 1;
        patches.push_back({{c[0], c[1], c[2]},
                           {n[0], n[1], n[2]},
                           (high[u] - low[u]) * (high[v] - low[v]) / (cells * cells),
                           first_surface + static_cast<int>(side)});
      }
    }
  }
}

/// A closed room of 4 x 3 x 2.5 with two boxes in it: 6 w² + 12 b² patches. S_ij = A_i A_j cos cos / (π r²) between
/// centres, 0 where a box is in between, scaled by D S D until every row of F sums to 1 (within fp32).
struct Room {
  std::vector<RoomPatch> patches;
  std::vector<double> area;
  FormFactorMatrix form_factors;
};

inline std::vector<std::vector<double>> closed(std::vector<std::vector<double>> s, const std::vector<double>& area) {
  const std::size_t n = s.size();
  std::vector<double> d(n, 1.0);
  for (int sweep = 0; sweep < 60; ++sweep) {
    std::vector<double> sums(n);
    for (std::size_t i = 0; i < n; ++i) {
      double sum = 0;
      for (std::size_t j = 0; j < n; ++j) sum += s[i][j] * d[j];
      sums[i] = d[i] * sum;
    }
    for (std::size_t i = 0; i < n; ++i) d[i] *= sums[i] > 0 ? std::sqrt(area[i] / sums[i]) : 1.0;
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) s[i][j] *= d[i] * d[j];
  }
  return s;
}

inline Room make_room(int wall_cells, int box_cells) {
  Room room;
  const std::array boxes{Box{{0.5, 0.5, 0}, {1.3, 1.4, 1.2}}, Box{{2.2, 1.5, 0}, {3.1, 2.4, 0.8}}};
  add_sides(room.patches, {{0, 0, 0}, {4, 3, 2.5}}, wall_cells, true, 0);
  add_sides(room.patches, boxes[0], box_cells, false, 6);
  add_sides(room.patches, boxes[1], box_cells, false, 12);
  std::erase_if(room.patches, [](const RoomPatch& p) { return p.surface == 10 || p.surface == 16; });  // on the floor
  const std::size_t n = room.patches.size();
  for (const RoomPatch& p : room.patches) room.area.push_back(p.area);
  std::vector<std::vector<double>> s(n, std::vector<double>(n));
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const RoomPatch &p = room.patches[i], &q = room.patches[j];
      const Vec3 d = q.centre - p.centre;
      const double cos_p = dot(p.normal, d), cos_q = -dot(q.normal, d), r2 = dot(d, d);
      if (cos_p <= 1e-9 || cos_q <= 1e-9) continue;
      if (blocked(boxes[0], p.centre, q.centre) || blocked(boxes[1], p.centre, q.centre)) continue;
      s[i][j] = s[j][i] = p.area * q.area * cos_p * cos_q / (std::numbers::pi * r2 * r2);
    }
  }
  s = closed(std::move(s), room.area);
  room.form_factors = FormFactorMatrix(static_cast<std::uint32_t>(n));
  for (std::uint32_t i = 0; i < n; ++i) {
    const auto row = room.form_factors.row(i);
    for (std::uint32_t j = 0; j < n; ++j) row[j] = static_cast<float>(s[i][j] / room.area[i]);
  }
  return room;
}

/// The same matrix in panels of at most so many bytes.
inline FormFactorMatrix repanelled(const FormFactorMatrix& f, std::uint64_t max_panel_bytes) {
  FormFactorMatrix result(f.size(), max_panel_bytes);
  for (std::uint32_t i = 0; i < f.size(); ++i) std::copy(f.row(i).begin(), f.row(i).end(), result.row(i).begin());
  return result;
}

/// Three channels: walls near `bright` in red and less in green and blue, boxes darker; the lamp, a few patches in the
/// middle of the ceiling, has ρ = 0 and e = 10, 8, 6.
struct Light {
  Columns reflectance, emittance;
};

inline Light lamp_light(const Room& room, float bright) {
  const std::size_t n = room.patches.size();
  Light light{Columns(3, std::vector<float>(n)), Columns(3, std::vector<float>(n))};
  for (std::size_t i = 0; i < n; ++i) {
    const RoomPatch& p = room.patches[i];
    const bool lamp = p.surface == 5 && std::abs(p.centre.x - 2) < 0.6 && std::abs(p.centre.y - 1.5) < 0.6;
    for (std::size_t c = 0; c < 3; ++c) {
      const float tint = 1.0F - 0.12F * static_cast<float>((p.surface + static_cast<int>(c)) % 3);
      const float wall = bright * (p.surface < 6 ? 1.0F : 0.7F) * (c == 0 && p.surface < 6 ? 1.0F : tint);
      light.reflectance[c][i] = lamp ? 0.0F : wall;
      light.emittance[c][i] = lamp ? 10.0F - 2.0F * static_cast<float>(c) : 0.0F;
    }
  }
  return light;
}

/// A closed scene in which every patch sees every other alike: F_ij = A_j / Σ A.
inline Room sphere(std::uint32_t n) {
  Room room;
  room.form_factors = FormFactorMatrix(n);
  double total = 0;
  for (std::uint32_t i = 0; i < n; ++i) room.area.push_back(1.0 + 0.5 * std::sin(0.7 * i));
  for (const double a : room.area) total += a;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) room.form_factors.row(i)[j] = static_cast<float>(room.area[j] / total);
  }
  return room;
}

}  // namespace interflect::test
