#include "interflect/scene/gltf_node.h"

#include <fmt/format.h>

#include <cmath>

#include "interflect/base/error.h"

namespace interflect::gltf {

namespace {

/// x, y, z, w, of any length but about 0.
Affine rotation(const std::vector<double>& q, double norm) {
  const double x = q[0] / norm, y = q[1] / norm, z = q[2] / norm, w = q[3] / norm;
  return {{1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
          {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
          {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)},
          {}};
}

}  // namespace

std::string node_name(const Document& document, int index) {
  const std::string& name = document.model.nodes[static_cast<std::size_t>(index)].name;
  return name.empty() ? fmt::format("node {}", index) : fmt::format("node {} ('{}')", index, name);
}

Affine transformation(const Document& document, int index) {
  const tinygltf::Node& node = document.model.nodes[static_cast<std::size_t>(index)];
  const auto fail = [&](std::string_view cause) {
    return input_error(document.file, 0, fmt::format("{}: {}", node_name(document, index), cause));
  };
  const auto has = [&](const std::vector<double>& list, std::size_t size, const char* what) {
    if (!list.empty() && list.size() != size) throw fail(fmt::format("{} has {} numbers", what, list.size()));
    return !list.empty();
  };
  Affine a;
  if (has(node.matrix, 16, "matrix")) {
    const auto& m = node.matrix;
    if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1) throw fail("matrix is not affine");
    a = {{m[0], m[1], m[2]}, {m[4], m[5], m[6]}, {m[8], m[9], m[10]}, {m[12], m[13], m[14]}};
  }
  if (has(node.rotation, 4, "rotation")) {
    const auto& q = node.rotation;
    const double norm = std::hypot(std::hypot(q[0], q[1]), std::hypot(q[2], q[3]));
    if (!(norm > 1e-6 && norm < 1e6)) throw fail("rotation is not a quaternion");
    a = rotation(q, norm);
  }
  if (has(node.scale, 3, "scale")) a = a * scaling({node.scale[0], node.scale[1], node.scale[2]});
  if (has(node.translation, 3, "translation")) {
    a.origin = {node.translation[0], node.translation[1], node.translation[2]};
  }
  return a;
}

}  // namespace interflect::gltf
