#include "interflect/solver/iterate_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string_view>

#include "interflect/base/error.h"
#include "interflect/base/file.h"
#include "interflect/formfactor/iff_format.h"

namespace interflect {

namespace {

static_assert(std::endian::native == std::endian::little, "the file is little-endian");

constexpr std::array<char, 8> magic{'\x89', 'I', 'F', 'C', '\r', '\n', '\x1a', '\n'};
constexpr std::uint32_t version = 1, byte_order = 0x01020304;

/// The header as it lies in the file. After it: made (u32 per column), b (f32, column after column), and the checksum.
struct Header {
  std::array<char, 8> magic;
  std::uint32_t version, byte_order, patches, columns, method, passes, products, restarts;
  double seconds;
  std::array<std::uint64_t, 2> geometry;
  std::uint64_t reflectance, emittance, exactly;
};
static_assert(sizeof(Header) == 88);

template <typename T>
std::span<const std::byte> bytes_of(const std::vector<T>& values) {
  return std::as_bytes(std::span(values));
}

std::uint64_t checksum_of(const Header& header, const Iterate& iterate) {
  std::uint64_t sum = iff::checksum(std::as_bytes(std::span(&header, 1)));
  sum = iff::checksum(bytes_of(iterate.made), sum);
  for (const std::vector<float>& column : iterate.b) sum = iff::checksum(bytes_of(column), sum);
  return sum;
}

/// Why a file of this header cannot be gone on from; empty: it can.
std::string misfit(const Header& header, const IterateKey& key) {
  if (header.patches != key.patches) {
    return fmt::format("it is of {} patches, and there are {}", header.patches, key.patches);
  }
  if (header.geometry != key.geometry) return "the geometry is another";
  if (header.columns != key.columns) {
    return fmt::format("it has {} columns, and there are {} now: the light groups are others", header.columns,
                       key.columns);
  }
  if (header.reflectance != key.reflectance) return "the reflectances are others";
  if (header.emittance != key.emittance) return "the lights are others";
  if (header.method != static_cast<std::uint32_t>(key.method)) {
    return fmt::format("it was made by --method {}", name(static_cast<Method>(header.method)));
  }
  if (header.exactly != key.exactly && key.exactly != 0) {
    return "--iterations goes on only from a solve with --iterations and the same form factors";
  }
  return "";
}

template <typename T>
void take(std::string_view& rest, std::span<T> to) {
  if (!to.empty()) std::memcpy(to.data(), rest.data(), to.size_bytes());
  rest.remove_prefix(to.size_bytes());
}

}  // namespace

std::uint32_t Iterate::iterations() const {
  return made.empty() ? 0 : *std::max_element(made.begin(), made.end());
}

std::uint64_t hash_of(const Columns& columns) {
  std::uint64_t sum = columns.size();
  for (const std::vector<float>& column : columns) sum = iff::checksum(bytes_of(column), sum);
  return sum;
}

void write_iterate(const std::string& file, const IterateKey& key, const Iterate& iterate) {
  const Header header{magic,           version,          byte_order,
                      key.patches,     key.columns,      static_cast<std::uint32_t>(key.method),
                      iterate.passes,  iterate.products, iterate.restarts,
                      iterate.seconds, key.geometry,     key.reflectance,
                      key.emittance,   key.exactly};
  const std::uint64_t sum = checksum_of(header, iterate);
  AtomicFile out(file);
  out.write(std::as_bytes(std::span(&header, 1)));
  out.write(bytes_of(iterate.made));
  for (const std::vector<float>& column : iterate.b) out.write(bytes_of(column));
  out.write(std::as_bytes(std::span(&sum, 1)));
  out.commit();
}

Iterate read_iterate(const std::string& file, const IterateKey& key) {
  const std::string bytes = read_file(file);
  Header header{};
  if (bytes.size() < sizeof header || !std::equal(magic.begin(), magic.end(), bytes.begin())) {
    throw input_error(file, 0, "is no checkpoint of a solve");
  }
  std::memcpy(&header, bytes.data(), sizeof header);
  if (header.version != version || header.byte_order != byte_order) {
    throw input_error(file, 0, fmt::format("is a checkpoint of another version ({}) or byte order", header.version));
  }
  const std::string damaged = "is damaged: remove it, and the solve begins anew";
  const std::uint64_t body = std::uint64_t{header.columns} * sizeof(std::uint32_t) +
                             std::uint64_t{header.columns} * header.patches * sizeof(float);
  // Divided first, so that no size in a damaged header can overflow.
  const bool possible = header.columns > 0 && header.columns <= bytes.size() / sizeof(std::uint32_t) &&
                        header.patches <= bytes.size() / sizeof(float) / header.columns;
  if (!possible || bytes.size() != sizeof header + body + sizeof(std::uint64_t) ||
      header.method > static_cast<std::uint32_t>(Method::jacobi)) {
    throw input_error(file, 0, damaged);
  }
  Iterate iterate;
  iterate.made.resize(header.columns);
  iterate.b.assign(header.columns, std::vector<float>(header.patches));
  std::string_view rest = std::string_view(bytes).substr(sizeof header);
  take(rest, std::span(iterate.made));
  for (std::vector<float>& column : iterate.b) take(rest, std::span(column));
  std::uint64_t sum = 0;
  take(rest, std::span(&sum, 1));
  if (sum != checksum_of(header, iterate)) throw input_error(file, 0, damaged);
  for (const std::vector<float>& column : iterate.b) {
    if (!std::all_of(column.begin(), column.end(), [](float b) { return std::isfinite(b); })) {
      throw input_error(file, 0, damaged);
    }
  }
  if (const std::string why = misfit(header, key); !why.empty()) {
    throw input_error(file, 0, fmt::format("is the checkpoint of another solve: {}", why));
  }
  iterate.products = header.products;
  iterate.passes = header.passes;
  iterate.restarts = header.restarts;
  iterate.seconds = header.seconds;
  return iterate;
}

}  // namespace interflect
