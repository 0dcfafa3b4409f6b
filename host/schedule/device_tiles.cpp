#include "interflect/schedule/device_tiles.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <exception>
#include <limits>

#include "interflect/device/kernel_arguments.h"
#include "interflect/formfactor/sampling.h"

namespace interflect {

namespace {

constexpr std::uint32_t block = PatchTable::block;
static_assert(block == assembly::block);

std::vector<Box> boxes_of(const PatchTable& patches) {
  std::vector<Box> boxes;
  for (std::size_t first = 0; first < patches.size; first += block) {
    Box box{patches.triangle(first)[0], patches.triangle(first)[0]};
    for (std::size_t i = first; i < std::min(first + block, patches.size); ++i) {
      for (const Vec3 p : patches.triangle(i)) box = {min(box.low, p), max(box.high, p)};
    }
    boxes.push_back(box);
  }
  return boxes;
}

/// Bit k: patch k of the block can see something of the box.
std::uint32_t seeing(const PatchTable& patches, std::size_t of, const Box& box) {
  std::uint32_t bits = 0;
  for (std::uint32_t k = 0; k < block && of * block + k < patches.size; ++k) {
    const std::size_t i = of * block + k;
    const Vec3 n = patches.front(i);
    const Vec3 farthest{n.x > 0 ? box.high.x : box.low.x, n.y > 0 ? box.high.y : box.low.y,
                        n.z > 0 ? box.high.z : box.low.z};
    if (dot(n, farthest) - patches.offset[i] > patches.tolerance[i]) bits |= 1U << k;
  }
  return bits;
}

/// The planes of the block's patches that take part, one after the other the same only once.
void add_planes(std::vector<kernel::Plane>& planes, Shaft& shaft, const PatchTable& patches, std::size_t of,
                std::uint32_t taking_part) {
  for (std::uint32_t k = 0; k < block; ++k) {
    if ((taking_part >> k & 1U) == 0) continue;
    const kernel::Plane plane = patches.plane(of * block + k);
    shaft.behind = std::min(shaft.behind, patches.tolerance[of * block + k]);
    if (planes.empty() || !(planes.back().normal == plane.normal) || planes.back().offset != plane.offset) {
      planes.push_back(plane);
    }
  }
}

std::vector<DeviceTile> tiles_of_row(const PatchTable& patches, const Blockers& blockers, const std::vector<Box>& boxes,
                                     double lift, std::uint32_t row) {
  std::vector<DeviceTile> tiles;
  std::size_t hint = 0;
  for (std::uint32_t column = row; column < boxes.size(); ++column) {
    DeviceTile tile{row, column, seeing(patches, row, boxes[column]), 0};
    if (tile.rows != 0) tile.columns = seeing(patches, column, boxes[row]);
    if (tile.columns == 0) continue;
    Shaft shaft(boxes[row], boxes[column], 2 * lift);
    shaft.behind = std::numeric_limits<double>::infinity();
    add_planes(shaft.from, shaft, patches, row, tile.rows);
    add_planes(shaft.to, shaft, patches, column, tile.columns);
    if (blockers.any_in(shaft, hint)) tile.row |= assembly::traced_bit;
    tiles.push_back(tile);
  }
  return tiles;
}

}  // namespace

std::vector<DeviceTile> device_tiles(const PatchTable& patches, const Blockers& blockers, double lift,
                                     std::uint32_t first, std::uint32_t end) {
  const std::vector<Box> boxes = boxes_of(patches);
  std::vector<std::vector<DeviceTile>> of_row(end - first);
  std::exception_ptr failure;
#pragma omp parallel for schedule(dynamic, 1)
  for (std::uint32_t row = first; row < end; ++row) {
    try {
      of_row[row - first] = tiles_of_row(patches, blockers, boxes, lift, row);
    } catch (...) {  // no exception may leave the region
#pragma omp critical(interflect_device_tiles)
      failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
  std::vector<DeviceTile> tiles;
  for (const auto& row : of_row) tiles.insert(tiles.end(), row.begin(), row.end());
  return tiles;
}

std::vector<std::uint32_t> device_patches(const PatchTable& patches, std::uint64_t seed) {
  const std::size_t padded = patches.blocks() * block;
  std::vector<std::uint32_t> words(padded * assembly::patch_words);
  for (std::size_t i = 0; i < padded; ++i) {
    const auto put = [&](std::size_t four, const Vec3& at, double fourth) {
      const double values[] = {at.x, at.y, at.z, fourth};
      for (std::size_t k = 0; k < 4; ++k) {
        words[i * assembly::patch_words + 4 * four + k] = std::bit_cast<std::uint32_t>(static_cast<float>(values[k]));
      }
    };
    constexpr double faces_nothing = 1e30;
    if (i >= patches.size) {
      put(1, {}, faces_nothing);
      continue;
    }
    const Vec3 c{patches.centroid[0][i], patches.centroid[1][i], patches.centroid[2][i]};
    const Vec3 high{static_cast<double>(static_cast<float>(c.x)), static_cast<double>(static_cast<float>(c.y)),
                    static_cast<double>(static_cast<float>(c.z))};
    const auto corners = patches.triangle(i);
    put(0, high, patches.radius[i]);
    put(1, c - high, patches.tolerance[i]);
    put(2, corners[0] - c, patches.area[i]);
    put(3, corners[1] - c, 0);
    put(4, corners[2] - c, 0);
    put(5, patches.front(i), 0);
    const auto patch = static_cast<std::uint32_t>(i);
    const sampling::Square row = sampling::word(seed, patch), column = sampling::word(seed + 1, patch);
    const std::uint32_t samples[] = {row.u, row.v, column.u, column.v};
    std::copy(std::begin(samples), std::end(samples), words.begin() + static_cast<std::ptrdiff_t>(i * 32 + 24));
  }
  return words;
}

}  // namespace interflect
