#include "interflect/formfactor/packed_matrix.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <map>
#include <numeric>

#include "interflect/base/error.h"

namespace interflect {
namespace {

using ::testing::HasSubstr;

constexpr Storage formats[] = {Storage::dense16, Storage::tiled16, Storage::sym16};

/// F with reciprocity: F_ij = S_ij / A_i with S symmetric, a band of zeros and areas over six orders of magnitude.
struct Example {
  explicit Example(std::uint32_t n) : form_factors(n) {
    for (std::uint32_t i = 0; i < n; ++i) area.push_back(std::pow(10.0, static_cast<double>(i % 7) - 3.0));
    for (std::uint32_t i = 0; i < n; ++i) {
      for (std::uint32_t j = 0; j < n; ++j) form_factors.row(i)[j] = static_cast<float>(s(i, j) / area[i]);
    }
  }
  [[nodiscard]] double s(std::uint32_t i, std::uint32_t j) const {
    const std::uint32_t low = std::min(i, j), high = std::max(i, j);
    if ((low / 40 + high / 40) % 3 == 0) return 0;
    const double wave = 0.55 + 0.45 * std::sin(static_cast<double>(low * 13 + high * 7));
    return wave * std::min(area[i], area[j]) / 4;
  }
  /// What PackedMatrix says it stores for two patches.
  [[nodiscard]] float h(std::uint32_t i, std::uint32_t j) const {
    return static_cast<float>(32768 * s(i, j) / std::sqrt(area[i] * area[j]));
  }
  FormFactorMatrix form_factors;
  std::vector<double> area;
};

std::vector<std::uint32_t> backwards(std::uint32_t n) {
  std::vector<std::uint32_t> order(n);
  std::iota(order.rbegin(), order.rend(), 0U);
  return order;
}

/// All elements by place, from the panels' bytes and index alone: what a kernel sees.
std::map<std::pair<std::uint32_t, std::uint32_t>, float> elements(const PackedMatrix& matrix, std::uint64_t max_bytes,
                                                                  std::uint32_t max_units) {
  std::map<std::pair<std::uint32_t, std::uint32_t>, float> all;
  std::uint32_t next_unit = 0;
  std::uint64_t bytes = 0;
  std::size_t panels = 0;
  for (const PackedMatrix::Panel& panel : matrix.panels(max_bytes, max_units)) {
    bytes += panel.elements.size() + panel.index.size() * sizeof(std::uint32_t);
    ++panels;
    EXPECT_EQ(panel.first, next_unit);
    EXPECT_LE(panel.units, max_units);
    EXPECT_LE(panel.elements.size(), max_bytes);
    EXPECT_EQ(panel.elements.size(), std::size_t{panel.tiles} * tile_elements * sizeof(Half));
    next_unit += panel.units;
    const auto* halves = reinterpret_cast<const Half*>(panel.elements.data());
    const auto add = [&](std::uint32_t row, std::uint32_t column, std::uint32_t tile) {
      for (std::uint32_t e = 0; e < tile_elements; ++e) {
        const Half half = halves[std::size_t{tile} * tile_elements + e];
        if (half != 0) all[{row + e / tile_columns, column + e % tile_columns}] = from_half(half);
      }
    };
    const auto& index = panel.index;
    if (matrix.storage() == Storage::sym16) {
      const std::uint32_t* strip = index.data() + std::size_t{4} * panel.units;
      const std::uint32_t* begin = strip + panel.strips;
      const std::uint32_t* column = begin + panel.strips + 1;
      EXPECT_EQ(index.size(), std::size_t{4} * panel.units + 2 * panel.strips + 1 + panel.tiles);
      for (std::uint32_t u = 0; u < panel.units; ++u) {
        for (std::uint32_t s = index[4 * u + 2]; s < index[4 * u + 3]; ++s) {
          for (std::uint32_t t = begin[s]; t < begin[s + 1]; ++t) {
            add(index[4 * u] * matrix.block() + strip[s] * tile_rows,
                index[4 * u + 1] * matrix.block() + column[t] * tile_columns, t);
          }
        }
      }
    } else {
      EXPECT_EQ(index.size(), std::size_t{panel.strips} + 1 + panel.tiles);
      for (std::uint32_t s = 0; s < panel.strips; ++s) {
        for (std::uint32_t t = index[s]; t < index[s + 1]; ++t) {
          add((panel.first + s) * tile_rows, index[panel.strips + 1 + t] * tile_columns, t);
        }
      }
    }
  }
  // A panel that was cut again has one beginning more.
  EXPECT_GE(bytes, matrix.bytes());
  EXPECT_LE(bytes, matrix.bytes() + panels * sizeof(std::uint32_t));
  return all;
}

/// 1 half unit of an element of this size.
double half_unit(double value) {
  return std::max(std::abs(value) * 0x1p-11, 0x1p-25);
}

void compare(const Example& example, const PackedMatrix& matrix, std::uint64_t max_bytes, std::uint32_t max_units) {
  const auto found = elements(matrix, max_bytes, max_units);
  const std::uint32_t n = matrix.size();
  std::size_t stored = 0;
  for (std::uint32_t i = 0; i < n; ++i) {
    for (std::uint32_t j = 0; j < n; ++j) {
      const auto at = found.find({i, j});
      const float value = at == found.end() ? 0.0F : at->second;
      stored += at == found.end() ? 0 : 1;
      double wanted = example.h(matrix.order()[i], matrix.order()[j]);
      if (matrix.storage() == Storage::sym16) wanted = j < i ? 0 : j == i ? wanted / 2 : wanted;
      ASSERT_NEAR(value, wanted, half_unit(wanted) * 1.001) << name(matrix.storage()) << " " << i << " " << j;
    }
  }
  EXPECT_EQ(stored, found.size()) << "elements past n";
}

TEST(PackedMatrix, HoldsWhatItSaysInEveryFormatOrderAndPanel) {
  for (const std::uint32_t n : {1U, 7U, 16U, 17U, 100U, 257U}) {
    const Example example(n);
    for (const Storage storage : formats) {
      for (const bool reversed : {false, true}) {
        PackedMatrix::Options options;
        if (reversed) options.order = backwards(n);
        options.block = 48;
        for (const std::uint64_t chunk : {std::uint64_t{1} << 30, std::uint64_t{20'000}}) {
          options.max_panel_bytes = chunk;
          const PackedMatrix matrix(example.form_factors, example.area, storage, options);
          compare(example, matrix, std::uint64_t{1} << 30, 1'000'000);
          compare(example, matrix, 40'000, 3);
        }
      }
    }
  }
}

TEST(PackedMatrix, EmptyTilesAreNotStored) {
  FormFactorMatrix f(64);
  f.row(3)[40] = f.row(40)[3] = 0.25F;
  f.row(20)[20] = 0.5F;
  const std::vector<double> area(64, 2.0);
  const PackedMatrix dense(f, area, Storage::dense16), tiled(f, area, Storage::tiled16), sym(f, area, Storage::sym16);
  EXPECT_EQ(dense.stored_elements(), 64U * 64);
  EXPECT_EQ(tiled.stored_elements(), 3U * tile_elements);
  EXPECT_EQ(sym.stored_elements(), 2U * tile_elements);
  for (const PackedMatrix* matrix : {&dense, &tiled, &sym}) {
    EXPECT_DOUBLE_EQ(matrix->nonzero_fraction(), 3.0 / 4096);
  }
  EXPECT_LT(sym.bytes(), tiled.bytes());
  const FormFactorMatrix nothing(33);
  const std::vector<double> areas(33, 1.0);
  EXPECT_EQ(PackedMatrix(nothing, areas, Storage::sym16).stored_elements(), 0U);
  EXPECT_EQ(PackedMatrix(nothing, areas, Storage::tiled16).stored_elements(), 0U);
  EXPECT_TRUE(PackedMatrix(nothing, areas, Storage::sym16).panels(1 << 20, 100).empty());
}

/// F_ij up to 1 between patches of any two areas that reciprocity allows, down to where fp16 ends.
TEST(PackedMatrix, NothingOverflowsAndWhatIsLostIsBelowTheDocumentedSize) {
  FormFactorMatrix f(16);
  std::vector<double> area(16, 1.0);
  area[1] = 1e-8;
  f.row(1)[0] = 1.0F;  // all that the small patch sends arrives at the large one
  f.row(0)[1] = 1e-8F;
  f.row(2)[3] = f.row(3)[2] = 1.0F;
  f.row(4)[5] = f.row(5)[4] = 0x1p-29F * 1.25F;  // the last with eleven bits
  f.row(6)[7] = f.row(7)[6] = 0x1p-40F * 0.99F;  // lost
  const PackedMatrix matrix(f, area, Storage::tiled16);
  const auto found = elements(matrix, 1 << 20, 100);
  EXPECT_NEAR(found.at({1, 0}), 32768 * 1e-4, 32768 * 1e-4 * 0x1p-11);
  EXPECT_EQ(found.at({2, 3}), 32768.0F);
  EXPECT_EQ(found.at({4, 5}), 0x1p-14F * 1.25F);
  EXPECT_FALSE(found.contains({6, 7}));
  for (const auto& [place, value] : found) EXPECT_TRUE(std::isfinite(value));
}

TEST(PackedMatrix, RefusesWhatItCannotStore) {
  const Example example(20);
  const auto expect_error = [](ErrorKind kind, const std::string& part, const std::function<void()>& act) {
    try {
      act();
      FAIL() << "no error with " << part;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), kind);
      EXPECT_THAT(error.what(), HasSubstr(part));
    }
  };
  const auto pack = [&](Storage storage, const std::vector<double>& area, PackedMatrix::Options options) {
    static_cast<void>(PackedMatrix(example.form_factors, area, storage, std::move(options)));
  };
  expect_error(ErrorKind::usage, "dense32", [&] { pack(Storage::dense32, example.area, {}); });
  expect_error(ErrorKind::usage, "19 areas for 20", [&] { pack(Storage::sym16, std::vector<double>(19, 1.0), {}); });
  std::vector<double> area = example.area;
  area[7] = 0;
  expect_error(ErrorKind::input, "area of patch 7", [&] { pack(Storage::tiled16, area, {}); });
  area[7] = std::nan("");
  expect_error(ErrorKind::input, "area of patch 7", [&] { pack(Storage::tiled16, area, {}); });
  expect_error(ErrorKind::usage, "3 places", [&] { pack(Storage::sym16, example.area, {.order = {0, 1, 2}}); });
  std::vector<std::uint32_t> twice = backwards(20);
  twice[4] = twice[5];
  expect_error(ErrorKind::usage, "comes twice", [&] { pack(Storage::sym16, example.area, {.order = twice}); });
  twice[4] = 20;
  expect_error(ErrorKind::usage, "patch 20", [&] { pack(Storage::sym16, example.area, {.order = twice}); });
  expect_error(ErrorKind::usage, "multiple of 16", [&] { pack(Storage::sym16, example.area, {.block = 40}); });
  area[7] = 1e-90;
  expect_error(ErrorKind::input, "patch 7: 1e-90 is too far", [&] { pack(Storage::sym16, area, {}); });
  ::setenv("INTERFLECT_MEMORY", "1K", 1);
  const Example larger(100);
  for (const Storage storage : formats) {
    expect_error(ErrorKind::limit, "may be used",
                 [&] { static_cast<void>(PackedMatrix(larger.form_factors, larger.area, storage)); });
  }
  ::unsetenv("INTERFLECT_MEMORY");
  const PackedMatrix matrix(example.form_factors, example.area, Storage::dense16);
  expect_error(ErrorKind::limit, "a buffer takes 100", [&] { static_cast<void>(matrix.panels(100, 10)); });
}

}  // namespace
}  // namespace interflect
