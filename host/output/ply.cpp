#include <fmt/format.h>

#include <cmath>
#include <cstdint>
#include <string>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/output/bytes.h"
#include "interflect/output/output.h"
#include "interflect/output/smooth.h"
#include "interflect/output/tone.h"

namespace interflect {

namespace {

void append_vertex(std::string& out, Vec3 position, Vec3 normal, const Rgb& radiosity, double exposure) {
  for (const Vec3 v : {position, normal}) {
    for (int axis = 0; axis < 3; ++axis) append_little_endian(out, static_cast<float>(v[axis]));
  }
  const Rgb shown =
      tone_map({exposure * radiosity[0], exposure * radiosity[1], exposure * radiosity[2]}, ToneMap::linear);
  for (const double c : shown) append_little_endian(out, srgb_byte(c));
  for (const double c : radiosity) append_little_endian(out, finite_float(c));
}

}  // namespace

void write_ply(const Solution& solution, const std::filesystem::path& path) {
  check_solution(solution);
  const PatchMesh& mesh = *solution.mesh;
  AtomicFile file(path);
  const SmoothMesh smooth = smooth_mesh(mesh);
  const std::vector<Rgb> radiosity = smooth_radiosities(smooth, mesh, solution.radiosity);
  const double exposure = surface_exposure(mesh, solution.radiosity);
  std::string bytes = fmt::format(
      "ply\nformat binary_little_endian 1.0\n"
      "comment Interflect: a patch mesh with its radiosity\n"
      "comment radiosity_r, _g, _b: linear radiosity; red, green, blue: sRGB of {} times that, clipped\n"
      "element vertex {}\n"
      "property float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float radiosity_r\nproperty float radiosity_g\nproperty float radiosity_b\n"
      "element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
      exposure, smooth.size(), mesh.size());
  bytes.reserve(bytes.size() + 39 * smooth.size() + 13 * mesh.size());
  for (std::size_t s = 0; s < smooth.size(); ++s) {
    append_vertex(bytes, mesh.vertices[smooth.vertex[s]], smooth.normal[s], radiosity[s], exposure);
  }
  for (const auto& corners : smooth.corners) {
    append_little_endian(bytes, std::uint8_t{3});
    for (const std::uint32_t s : corners) append_little_endian(bytes, s);
  }
  file.write(bytes);
  file.commit();
}

}  // namespace interflect
