#pragma once

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "interflect/formfactor/descriptor.h"
#include "interflect/formfactor/tile_maker.h"
#include "interflect/scene/patch_mesh.h"

/// The bytes of a file of form factors, as docs/iff-format.md has them.
namespace interflect::iff {

inline constexpr std::array<char, 8> magic{'\x89', 'I', 'F', 'F', '\r', '\n', '\x1a', '\n'};
inline constexpr std::uint32_t version = 1;
inline constexpr std::uint32_t byte_order = 0x01020304;
inline constexpr std::uint64_t page = 4096;            ///< header, table and panels start at multiples of it
inline constexpr std::uint32_t storage_dense32_s = 0;  ///< rows of S in fp32; other numbers are reserved
inline constexpr std::uint32_t state_finished = 1;
inline constexpr std::uint32_t most_patches = 1U << 30;

/// The version of the arithmetic behind S: raised when the same geometry, accuracy and seed give other bits.
inline constexpr std::uint32_t algorithm = 2;

inline constexpr std::uint32_t maker_embree = 0, maker_opencl = 1, maker_vulkan = 2, maker_cuda = 3;
/// Of tiles from the kernels of a device with this DeviceInfo::backend.
[[nodiscard]] std::uint32_t maker_of(std::string_view backend);

/// What S depends on. Two files of equal keys have the same panels to the bit when the same machine made them and, if
/// kernels did, the same device with the same driver: neither is kept.
struct Key {
  std::array<std::uint64_t, 2> geometry{};  ///< geometry_hash()
  double eps = 0;                           ///< Accuracy::eps
  std::uint64_t seed = 0;
  std::uint32_t algorithm = iff::algorithm;
  std::uint32_t maker = maker_embree;  ///< who made the tiles: Embree or a backend's kernels
  friend bool operator==(const Key&, const Key&) = default;
};

/// 128 bits over the patches' corners, in order. Reflectance and emittance are not part of it.
[[nodiscard]] std::array<std::uint64_t, 2> geometry_hash(const PatchMesh& mesh);
/// 32 hexadecimal digits.
[[nodiscard]] std::string hex(const std::array<std::uint64_t, 2>& hash);

/// What the header says; the offsets follow from n and rows_per_panel.
struct Shape {
  std::uint32_t n = 0;
  std::uint32_t rows_per_panel = 0;  ///< a multiple of 32
  double divide = 0;                 ///< the area to which the scene was cut; 0: unknown
  bool two_sided = false;
  Key key;
  friend bool operator==(const Shape&, const Shape&) = default;

  [[nodiscard]] std::uint32_t stride() const { return (n + 15) / 16 * 16; }  ///< as FormFactorMatrix
  [[nodiscard]] std::uint32_t panels() const { return (n + rows_per_panel - 1) / rows_per_panel; }
  [[nodiscard]] std::uint32_t first(std::uint32_t panel) const { return panel * rows_per_panel; }
  [[nodiscard]] std::uint32_t rows(std::uint32_t panel) const;
  [[nodiscard]] std::uint64_t row_bytes() const { return std::uint64_t{stride()} * sizeof(float); }
  [[nodiscard]] std::uint64_t panel_bytes(std::uint32_t panel) const { return rows(panel) * row_bytes(); }
  [[nodiscard]] std::uint32_t first_tile_row(std::uint32_t panel) const { return first(panel) / 32; }
  [[nodiscard]] std::uint32_t end_tile_row(std::uint32_t panel) const { return (first(panel) + rows(panel) + 31) / 32; }
  [[nodiscard]] std::uint32_t tile_rows() const { return (n + 31) / 32; }
  [[nodiscard]] std::uint64_t variances(std::uint32_t panel) const;  ///< how many floats

  [[nodiscard]] static std::uint64_t table_offset() { return page; }
  [[nodiscard]] std::uint64_t data_offset() const;
  [[nodiscard]] std::uint64_t pitch() const;  ///< from one panel to the next
  [[nodiscard]] std::uint64_t panel_offset(std::uint32_t panel) const { return data_offset() + panel * pitch(); }
  [[nodiscard]] std::uint64_t variance_offset(std::uint32_t panel) const {
    return panel_offset(panel) + panel_bytes(panel);
  }
  /// Where a panel's bytes end: where the next one's start, or the closing section.
  [[nodiscard]] std::uint64_t panel_end(std::uint32_t panel) const;
  [[nodiscard]] std::uint64_t closing_offset() const { return panel_end(panels() - 1); }
};

/// Rows of a panel of about `target` bytes: a multiple of 32, at least 32, at most n rounded up.
[[nodiscard]] std::uint32_t rows_of_panel(std::uint32_t n, std::uint64_t target);

/// The header as it lies in the file.
struct HeaderBytes {
  std::array<char, 8> magic;
  std::uint32_t version, byte_order, n, stride, rows_per_panel, panels, storage, algorithm, maker, flags;
  std::array<std::uint64_t, 2> geometry;
  double divide, eps;
  std::uint64_t seed, table_offset, data_offset, pitch, closing_offset, checksum;
};
static_assert(sizeof(HeaderBytes) == 128);
inline constexpr std::uint32_t flag_two_sided = 1;

/// A panel's entry of the table, as it lies in the file.
struct EntryBytes {
  std::uint32_t state, panel;
  std::uint64_t rows_checksum, variance_checksum, pairs, analytic, rays, reserved, checksum;
};
static_assert(sizeof(EntryBytes) == 64);

/// What stands before the closing section's body.
struct ClosingBytes {
  std::uint64_t bytes, checksum;
};
static_assert(sizeof(ClosingBytes) == 16);

/// XXH3, 64 bits. Table entries and the closing section are seeded with the header's checksum, so that those of
/// another file do not fit.
[[nodiscard]] std::uint64_t checksum(std::span<const std::byte> bytes, std::uint64_t seed = 0);
[[nodiscard]] std::uint64_t seed_of(const Shape& shape);

[[nodiscard]] HeaderBytes header_of(const Shape& shape);
/// Throws an input Error that names the file when the header is not one, of another version, damaged, or says sizes
/// that do not go together.
[[nodiscard]] Shape shape_of(const HeaderBytes& header, std::string_view file);

/// Whether the entry is that of this panel, finished and undamaged.
[[nodiscard]] bool valid(const EntryBytes& entry, std::uint32_t panel, std::uint64_t seed);
/// The entries as they lie in the file, valid or not. Throws an input Error when the file ends before.
[[nodiscard]] std::vector<EntryBytes> read_table(const Descriptor& file, const std::string& name, const Shape& shape);
[[nodiscard]] EntryBytes sealed(EntryBytes entry, std::uint64_t seed);
/// Of a panel with these rows (the padding with them) and facts.
[[nodiscard]] EntryBytes finished_entry(std::uint32_t panel, std::span<const std::byte> rows, const TileFacts& facts,
                                        std::uint64_t seed);

/// "panel 3 (rows 1536 to 2047)".
[[nodiscard]] std::string panel_name(const Shape& shape, std::uint32_t panel);

}  // namespace interflect::iff
