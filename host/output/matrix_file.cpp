#include "interflect/output/matrix_file.h"

#include <fmt/format.h>

#include <bit>
#include <iterator>

#include "interflect/base/file.h"
#include "interflect/output/bytes.h"

namespace interflect {

namespace {

constexpr std::size_t chunk = std::size_t{1} << 20;

}  // namespace

void write_matrix_npy(const FormFactorRows& rows, std::uint32_t n, const std::filesystem::path& path) {
  static_assert(std::endian::native == std::endian::little);
  AtomicFile file(path);
  file.write(npy_header(fmt::format("({}, {})", n, n)));
  rows([&](std::uint32_t, std::span<const float> row) { file.write(std::as_bytes(row)); });
  file.commit();
}

void write_matrix_market(const FormFactorRows& rows, std::uint32_t n, const std::string& comment,
                         const std::filesystem::path& path) {
  AtomicFile file(path);
  std::uint64_t nonzero = 0;
  rows([&](std::uint32_t, std::span<const float> row) {
    for (const float f : row) nonzero += f != 0.0F ? 1 : 0;
  });
  std::string text =
      fmt::format("%%MatrixMarket matrix coordinate real general\n% {}\n{} {} {}\n", comment, n, n, nonzero);
  rows([&](std::uint32_t i, std::span<const float> row) {
    for (std::size_t j = 0; j < row.size(); ++j) {
      if (row[j] != 0.0F) fmt::format_to(std::back_inserter(text), "{} {} {}\n", i + 1, j + 1, row[j]);
    }
    if (text.size() < chunk) return;
    file.write(text);
    text.clear();
  });
  file.write(text);
  file.commit();
}

}  // namespace interflect
