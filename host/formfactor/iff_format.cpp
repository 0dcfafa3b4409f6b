#include "interflect/formfactor/iff_format.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <new>

#include "interflect/base/error.h"
#include "interflect/formfactor/tile_maker.h"

namespace interflect::iff {

static_assert(std::endian::native == std::endian::little,
              "the file is little-endian, and written as it lies in memory");

namespace {

std::uint64_t to_page(std::uint64_t bytes) {
  return (bytes + page - 1) / page * page;
}

}  // namespace

std::uint32_t maker_of(std::string_view backend) {
  if (backend == "opencl") return maker_opencl;
  if (backend == "vulkan") return maker_vulkan;
  if (backend == "cuda") return maker_cuda;
  throw Error(ErrorKind::internal, fmt::format("kernels of {} have no number in the file", backend));
}

std::array<std::uint64_t, 2> geometry_hash(const PatchMesh& mesh) {
  constexpr std::size_t at_a_time = 4096;
  std::vector<double> corners;
  corners.reserve(9 * at_a_time);
  XXH3_state_t* const state = XXH3_createState();
  if (state == nullptr) throw std::bad_alloc();
  XXH3_128bits_reset(state);
  const auto flush = [&] {
    XXH3_128bits_update(state, corners.data(), corners.size() * sizeof(double));
    corners.clear();
  };
  for (std::size_t i = 0; i < mesh.size(); ++i) {
    for (const Vec3 p : mesh.triangle(i)) {
      for (const double x : {p.x, p.y, p.z}) corners.push_back(x + 0.0);  // −0 and 0 are one
    }
    if (corners.size() == 9 * at_a_time) flush();
  }
  flush();
  const XXH128_hash_t hash = XXH3_128bits_digest(state);
  XXH3_freeState(state);
  return {hash.low64, hash.high64};
}

std::string hex(const std::array<std::uint64_t, 2>& hash) {
  return fmt::format("{:016x}{:016x}", hash[1], hash[0]);
}

std::uint32_t Shape::rows(std::uint32_t panel) const {
  return std::min(rows_per_panel, n - first(panel));
}

std::uint64_t Shape::variances(std::uint32_t panel) const {
  return tiles_in_rows(first_tile_row(panel), end_tile_row(panel), tile_rows());
}

std::uint64_t Shape::data_offset() const {
  return to_page(table_offset() + panels() * sizeof(EntryBytes));
}

std::uint64_t Shape::pitch() const {
  return to_page(panel_bytes(0) + variances(0) * sizeof(float));  // no panel has more than the first
}

std::uint64_t Shape::panel_end(std::uint32_t panel) const {
  if (panel + 1 < panels()) return panel_offset(panel + 1);
  return to_page(variance_offset(panel) + variances(panel) * sizeof(float));
}

std::uint32_t rows_of_panel(std::uint32_t n, std::uint64_t target) {
  constexpr std::uint64_t tile = 32;
  const std::uint64_t row_bytes = std::uint64_t{(n + 15) / 16 * 16} * sizeof(float);
  const std::uint64_t rows = target / std::max<std::uint64_t>(1, row_bytes) / tile * tile;
  return static_cast<std::uint32_t>(std::clamp(rows, tile, (std::max(1U, n) + tile - 1) / tile * tile));
}

std::uint64_t checksum(std::span<const std::byte> bytes, std::uint64_t seed) {
  return XXH3_64bits_withSeed(bytes.data(), bytes.size(), seed);
}

HeaderBytes header_of(const Shape& shape) {
  HeaderBytes out{};
  out.magic = magic;
  out.version = version;
  out.byte_order = byte_order;
  out.n = shape.n;
  out.stride = shape.stride();
  out.rows_per_panel = shape.rows_per_panel;
  out.panels = shape.panels();
  out.storage = storage_dense32_s;
  out.algorithm = shape.key.algorithm;
  out.maker = shape.key.maker;
  out.flags = shape.two_sided ? flag_two_sided : 0;
  out.geometry = shape.key.geometry;
  out.divide = shape.divide;
  out.eps = shape.key.eps;
  out.seed = shape.key.seed;
  out.table_offset = Shape::table_offset();
  out.data_offset = shape.data_offset();
  out.pitch = shape.pitch();
  out.closing_offset = shape.closing_offset();
  out.checksum = checksum(std::as_bytes(std::span(&out, 1)).first(offsetof(HeaderBytes, checksum)));
  return out;
}

Shape shape_of(const HeaderBytes& header, std::string_view file) {
  const auto refuse = [&](const std::string& cause) { return input_error(file, 0, cause); };
  if (header.magic != magic) throw refuse("is not a file of form factors (.iff)");
  if (header.byte_order == std::uint32_t{0x04030201}) throw refuse("was written on a machine of the other byte order");
  if (header.version != version) {
    throw refuse(fmt::format("is of version {} of the format, this program reads version {}", header.version, version));
  }
  if (header.checksum != checksum(std::as_bytes(std::span(&header, 1)).first(offsetof(HeaderBytes, checksum)))) {
    throw refuse("header: checksum differs");
  }
  if (header.storage != storage_dense32_s) throw refuse(fmt::format("storage format {} is not known", header.storage));
  if (header.n == 0 || header.n > most_patches) throw refuse(fmt::format("header: {} patches", header.n));
  if (header.rows_per_panel == 0 || header.rows_per_panel % 32 != 0 || header.rows_per_panel > most_patches) {
    throw refuse(fmt::format("header: {} rows per panel", header.rows_per_panel));
  }
  const auto sensible = [](double x) { return std::isfinite(x) && x >= 0; };
  if (!sensible(header.divide) || !sensible(header.eps)) throw refuse("header: the numbers make no sense");
  Shape shape{header.n,
              header.rows_per_panel,
              header.divide,
              (header.flags & flag_two_sided) != 0,
              {header.geometry, header.eps, header.seed, header.algorithm, header.maker}};
  const HeaderBytes expected = header_of(shape);
  if (std::memcmp(&expected, &header, sizeof header) != 0) throw refuse("header: the sizes do not go together");
  return shape;
}

std::uint64_t seed_of(const Shape& shape) {
  return header_of(shape).checksum;
}

bool valid(const EntryBytes& entry, std::uint32_t panel, std::uint64_t seed) {
  return entry.state == state_finished && entry.panel == panel && sealed(entry, seed).checksum == entry.checksum;
}

EntryBytes sealed(EntryBytes entry, std::uint64_t seed) {
  entry.checksum = checksum(std::as_bytes(std::span(&entry, 1)).first(offsetof(EntryBytes, checksum)), seed);
  return entry;
}

EntryBytes finished_entry(std::uint32_t panel, std::span<const std::byte> rows, const TileFacts& facts,
                          std::uint64_t seed) {
  EntryBytes entry{};
  entry.state = state_finished;
  entry.panel = panel;
  entry.rows_checksum = checksum(rows);
  entry.variance_checksum = checksum(std::as_bytes(std::span(facts.variance)));
  entry.pairs = facts.pairs_considered;
  entry.analytic = facts.pairs_analytic;
  entry.rays = facts.rays;
  return sealed(entry, seed);
}

std::string panel_name(const Shape& shape, std::uint32_t panel) {
  return fmt::format("panel {} (rows {} to {})", panel, shape.first(panel), shape.first(panel) + shape.rows(panel) - 1);
}

}  // namespace interflect::iff
