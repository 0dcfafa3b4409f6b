#include <gmock/gmock.h>

#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>

#include "interflect/base/file.h"
#include "interflect/output/output.h"
#include "output/rooms.h"

namespace interflect {
namespace {

using namespace std::string_literals;
using test::Lit;
using test::SceneBuilder;
using test::TemporaryFolder;

Scene two_walls() {
  SceneBuilder s;
  s.quad("wall", s.material({0.1, 0.2, 0.3}), {0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0});
  s.quad("lamp", s.material({0.4, 0.5, 0.6}, {7, 8, 9}), {0, 0, 1}, {0, 1, 1}, {1, 1, 1}, {1, 0, 1});
  return s.scene();
}

void fill(Lit& lit) {
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const auto k = static_cast<double>(i);
    lit.solution.radiosity[i] = {1 / (k + 3), std::sqrt(k) * 1e-7, std::exp(k)};
    lit.solution.row_sum[i] = 1 - 0.1 / (k + 3);
  }
}

/// Fields of one CSV line by RFC 4180.
std::vector<std::string> fields(const std::string& line) {
  std::vector<std::string> out(1);
  bool quoted = false;
  for (std::size_t k = 0; k < line.size(); ++k) {
    const char c = line[k];
    if (quoted && c == '"' && k + 1 < line.size() && line[k + 1] == '"') {
      out.back() += line[++k];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      out.emplace_back();
    } else {
      out.back() += c;
    }
  }
  EXPECT_FALSE(quoted) << line;
  return out;
}

std::vector<std::string> lines(const std::string& text) {
  EXPECT_EQ(text.back(), '\n');
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) out.push_back(line);
  return out;
}

TEST(CsvTest, HoldsEveryPatchExactly) {
  const TemporaryFolder folder;
  Lit lit(two_walls(), 0.1);
  fill(lit);
  write_csv(lit.solution, folder / "x.csv");
  const auto text = lines(read_file(folder / "x.csv"));
  ASSERT_EQ(text.size(), lit.mesh.size() + 1);
  EXPECT_EQ(text[0], "index,group,area,cx,cy,cz,nx,ny,nz,rho_r,rho_g,rho_b,e_r,e_g,e_b,b_r,b_g,b_b,row_sum");
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const auto f = fields(text[i + 1]);
    ASSERT_EQ(f.size(), 19U);
    EXPECT_EQ(f[0], std::to_string(i));
    EXPECT_EQ(f[1], lit.mesh.normal[i].z > 0 ? "wall" : "lamp");
    const Vec3 c = lit.mesh.centroid[i], n = lit.mesh.normal[i];
    const Rgb rho = lit.mesh.reflectance[i], e = lit.mesh.emittance[i], b = lit.solution.radiosity[i];
    const std::vector<double> expected{lit.mesh.area[i],
                                       c.x,
                                       c.y,
                                       c.z,
                                       n.x,
                                       n.y,
                                       n.z,
                                       rho[0],
                                       rho[1],
                                       rho[2],
                                       e[0],
                                       e[1],
                                       e[2],
                                       b[0],
                                       b[1],
                                       b[2],
                                       lit.solution.row_sum[i]};
    for (std::size_t k = 0; k < expected.size(); ++k) {
      EXPECT_EQ(std::strtod(f[k + 2].c_str(), nullptr), expected[k]) << text[0] << '\n' << text[i + 1];
    }
  }
}

TEST(CsvTest, SurvivesHostileNames) {
  const TemporaryFolder folder;
  Lit lit(two_walls(), 0);
  lit.solution.grouping.names[0] = "a,\"b\"\r\n\0c"s;
  lit.solution.grouping.names[1] = "Tür \xF0\x9F\x92\xA1 \xC0\xAF \xED\xA0\x80 \xFF";
  write_csv(lit.solution, folder / "x.csv");
  const auto text = lines(read_file(folder / "x.csv"));
  ASSERT_EQ(text.size(), lit.mesh.size() + 1);
  for (std::size_t i = 0; i < lit.mesh.size(); ++i) {
    const auto f = fields(text[i + 1]);
    ASSERT_EQ(f.size(), 19U);
    const std::string bad = "\xEF\xBF\xBD";
    // Overlong forms and surrogates are not UTF-8: one U+FFFD for each of their bytes.
    EXPECT_EQ(f[1], lit.mesh.normal[i].z > 0 ? "a,\"b\"   c"
                                             : "Tür \xF0\x9F\x92\xA1 " + bad + bad + " " + bad + bad + bad + " " + bad);
  }
}

TEST(NpyTest, HasTheHeaderThatNumpyReads) {
  const TemporaryFolder folder;
  Lit lit(two_walls(), 0.1);
  fill(lit);
  write_npy(lit.solution, folder / "x.npy");
  const std::string file = read_file(folder / "x.npy");
  ASSERT_GT(file.size(), 128U);
  EXPECT_EQ(file.substr(0, 8), "\x93NUMPY\x01\x00"s);
  const auto header = static_cast<std::size_t>(static_cast<unsigned char>(file[8])) +
                      256 * static_cast<std::size_t>(static_cast<unsigned char>(file[9]));
  const std::size_t data = 10 + header;
  EXPECT_EQ(data % 64, 0U);
  EXPECT_EQ(file[data - 1], '\n');
  EXPECT_THAT(file.substr(10, header), ::testing::HasSubstr("'descr': '<f4'"));
  EXPECT_THAT(file.substr(10, header), ::testing::HasSubstr("'fortran_order': False"));
  EXPECT_THAT(file.substr(10, header), ::testing::HasSubstr("'shape': (" + std::to_string(lit.mesh.size()) + ", 3)"));
  ASSERT_EQ(file.size() - data, 12 * lit.mesh.size());
  for (std::size_t k = 0; k < 3 * lit.mesh.size(); ++k) {
    std::uint32_t bits = 0;
    for (std::size_t b = 4; b-- > 0;) bits = 256 * bits + static_cast<unsigned char>(file[data + 4 * k + b]);
    EXPECT_EQ(std::bit_cast<float>(bits), static_cast<float>(lit.solution.radiosity[k / 3][k % 3]));
  }
}

TEST(TableTest, SaysWhatIsNotANumber) {
  const TemporaryFolder folder;
  Lit lit(two_walls(), 0);
  lit.solution.radiosity[0][0] = std::numeric_limits<double>::quiet_NaN();
  write_csv(lit.solution, folder / "x.csv");
  EXPECT_EQ(fields(lines(read_file(folder / "x.csv"))[1])[15], "nan");
}

}  // namespace
}  // namespace interflect
