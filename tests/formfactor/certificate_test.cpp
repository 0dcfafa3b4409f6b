#include "interflect/formfactor/certificate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <memory>
#include <set>
#include <span>

#include "formfactor/meshes.h"
#include "interflect/formfactor/closure.h"
#include "interflect/formfactor/embree_tiles.h"

namespace interflect {
namespace {

using test::Builder;
using ::testing::AnyOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::IsEmpty;

constexpr Vec3 size{4, 3, 2.5};

/// A room whose walls are parts of their own; `strip` of the width is missing from wall "x1", `turned` turns it round.
Builder room(double strip = 0, bool turned = false) {
  constexpr int n = 5;
  const Vec3 x{size.x, 0, 0}, y{0, size.y, 0}, z{0, 0, size.z};
  Builder b;
  b.part("floor").plate({}, x, y, n);
  b.part("ceiling").plate(z, y, x, n);
  b.part("x0").plate({}, y, z, n);
  const Vec3 width = (1 - strip) * y;
  b.part("x1");
  turned ? b.plate(x, width, z, n) : b.plate(x, z, width, n);
  b.part("y0").plate({}, z, x, n);
  b.part("y1").plate(y, x, z, n);
  return b;
}

/// Half of the box is below the floor, or none of it: then it stands a little above.
Builder with_box(bool sunk) {
  Builder b = room();
  const double low = sunk ? -0.47 : 0.1;
  b.part("box").box({1.13, 0.87, low}, {2.41, 1.93, low + 0.94}, false, 3);
  return b;
}

Certificate certificate(const Builder& b) {
  return assemble(b.mesh()).report.certificate;
}

std::set<Cause> causes(const Certificate& c) {
  std::set<Cause> out;
  for (const SuspectRow& row : c.worst) out.insert(row.cause);
  return out;
}

std::multiset<std::string> named(const Certificate& c, Cause cause) {
  std::multiset<std::string> out;
  for (const SuspectRow& row : c.worst) {
    if (row.cause == cause) out.insert(row.other);
  }
  return out;
}

TEST(Certificate, ACleanRoomHasNoCauseButSampling) {
  for (const Builder& b : {room(), with_box(false)}) {
    const Certificate c = certificate(b);
    EXPECT_TRUE(c.made);
    EXPECT_EQ(c.rows, b.mesh().size());
    EXPECT_EQ(c.off, 0U);
    EXPECT_EQ(c.worst.size(), 20U);
    EXPECT_THAT(causes(c), Each(Cause::sampling));
    for (const SuspectRow& row : c.worst) {
      EXPECT_EQ(row.object, b.mesh().surfaces[b.mesh().surface[row.patch]].object);
      EXPECT_EQ(row.centroid, b.mesh().centroid[row.patch]);
      EXPECT_DOUBLE_EQ(row.deviation, row.row_sum - 1);
    }
    for (std::size_t k = 1; k < c.worst.size(); ++k) {
      EXPECT_GE(std::abs(c.worst[k - 1].deviation), std::abs(c.worst[k].deviation)) << "the worst first";
    }
  }
}

TEST(Certificate, AFlippedWallIsNamed) {
  const Certificate c = certificate(room(0, true));
  EXPECT_GT(c.off, c.rows / 2) << "all the other walls miss it";
  ASSERT_EQ(c.worst.size(), 20U);
  EXPECT_THAT(causes(c), Each(Cause::flipped_normal));
  EXPECT_THAT(named(c, Cause::flipped_normal), Each(std::string("x1")));
}

/// Not joined to its neighbours by edges, so that the winding says nothing: its back in view is enough.
TEST(Certificate, ABackInViewIsAFlippedNormalWithoutAnyEdge) {
  Builder b = room();
  b.part("screen").plate({1, 1, 0.5}, {1, 0, 0}, {0, 0, 1}, 3);
  const Certificate c = certificate(b);
  EXPECT_GT(c.off, 0U);
  EXPECT_THAT(causes(c), Each(AnyOf(Cause::flipped_normal, Cause::sampling)));
  EXPECT_THAT(named(c, Cause::flipped_normal), Each(std::string("screen")));
  EXPECT_THAT(named(c, Cause::flipped_normal), ::testing::SizeIs(::testing::Ge(10U)));
  // Twin: a screen with a patch on each side hides nothing from the row sums.
  Builder two = room();
  two.part("screen").plate({1, 1, 0.5}, {1, 0, 0}, {0, 0, 1}, 3).plate({1, 1, 0.5}, {0, 0, 1}, {1, 0, 0}, 3);
  EXPECT_THAT(named(certificate(two), Cause::flipped_normal), IsEmpty());
}

TEST(Certificate, ABoxHalfSunkInTheFloorPenetratesIt) {
  const Certificate c = certificate(with_box(true));
  EXPECT_GT(c.off, 0U);
  EXPECT_THAT(causes(c), Contains(Cause::interpenetration));
  EXPECT_THAT(causes(c), Each(AnyOf(Cause::interpenetration, Cause::sampling)));
  for (const SuspectRow& row : c.worst) {
    if (row.cause != Cause::interpenetration) continue;
    EXPECT_THAT(row.object, AnyOf("box", "floor"));
    EXPECT_THAT(row.other, AnyOf("box", "floor", ""));
    EXPECT_NE(row.other, row.object);
  }
}

TEST(Certificate, AMissingStripIsAnOpenSeam) {
  const Certificate c = certificate(room(0.05));
  EXPECT_GT(c.off, 0U);
  EXPECT_THAT(causes(c), Contains(Cause::open_seam));
  EXPECT_THAT(causes(c), Each(AnyOf(Cause::open_seam, Cause::sampling)));
  const std::multiset<std::string> at = named(c, Cause::open_seam);
  EXPECT_GT(at.size(), 5U);
  EXPECT_THAT(at, Each(AnyOf("x1", "y1", "floor", "ceiling"))) << "the surfaces round the hole";
}

/// A room without a wall is no room with a seam: what leaves it goes to the sky.
TEST(Certificate, AnOpenScenesRemainderGoesToTheSky) {
  Builder b;
  b.part("low").plate({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 6);
  b.part("high").plate({0, 0, 1}, {0, 1, 0}, {1, 0, 0}, 6);
  const FormFactors f = assemble(b.mesh());
  EXPECT_EQ(f.report.certificate.off, 0U);
  EXPECT_THAT(causes(f.report.certificate), Each(Cause::sampling));
  for (const SuspectRow& row : f.report.certificate.worst) {
    EXPECT_LT(row.row_sum, 0.5);
    EXPECT_LT(std::abs(row.deviation), 0.15);
  }
  const GroupFactors table = between(f.matrix, b.mesh(), b.grouping());
  for (std::size_t a = 0; a < 2; ++a) {
    EXPECT_NEAR(table.sky[a], 1 - table.factors[a][0] - table.factors[a][1], 1e-12);
    EXPECT_NEAR(table.sky[a], 1 - 0.199824895698387, 1e-4);
  }
  // Per patch as well: nothing is given to the patches in sight.
  for (std::size_t i = 0; i < f.report.row_sum.size(); ++i) {
    EXPECT_LE(f.report.row_sum[i], 1);
    EXPECT_NEAR(f.report.row_sum[i], f.report.row_sum_before[i], 1e-6);
  }
}

TEST(Certificate, TheRulesInTheirOrder) {
  RowFacts facts;
  facts.error = 1e-3;
  facts.deviation = -4e-3;
  EXPECT_EQ(likely_cause(facts), Cause::sampling);
  facts.deviation = -0.1;
  EXPECT_EQ(likely_cause(facts), Cause::unknown);
  facts.around.near = 0.3;
  EXPECT_EQ(likely_cause(facts), Cause::coarse_mesh);
  facts.around.escape = 0.04;
  EXPECT_EQ(likely_cause(facts), Cause::coarse_mesh) << "less than half of what is missing";
  facts.around.escape = 0.06;
  EXPECT_EQ(likely_cause(facts), Cause::open_seam);
  facts.seam = false;
  EXPECT_EQ(likely_cause(facts), Cause::coarse_mesh) << "in an open scene that is the sky";
  facts.seam = true;
  facts.around.back = 0.06;
  EXPECT_EQ(likely_cause(facts), Cause::flipped_normal);
  facts.around.inside = 0.1;
  EXPECT_EQ(likely_cause(facts), Cause::interpenetration);
  facts.around.back_of_turned = 0.05;
  EXPECT_EQ(likely_cause(facts), Cause::flipped_normal);
  facts.around.back_of_turned = 0;
  facts.turned = true;
  EXPECT_EQ(likely_cause(facts), Cause::flipped_normal);
  facts.deviation = 0.1;
  EXPECT_EQ(likely_cause(facts), Cause::coarse_mesh) << "backs and escapes explain no excess";
  facts.around.near = 0.2;
  EXPECT_EQ(likely_cause(facts), Cause::unknown);
}

TEST(Certificate, EdgesKnowWhatIsTurnedAndOpen) {
  EXPECT_THAT(edges_of(room().mesh()).open, IsEmpty());
  EXPECT_THAT(edges_of(room().mesh()).turned, Each(false));
  const Builder flipped = room(0, true);
  const MeshEdges edges = edges_of(flipped.mesh());
  for (std::size_t i = 0; i < flipped.mesh().size(); ++i) {
    EXPECT_EQ(edges.turned[i], flipped.mesh().surfaces[flipped.mesh().surface[i]].object == "x1");
  }
  EXPECT_FALSE(edges_of(room(0.05).mesh()).open.empty());
}

/// S as a store of panels gets it.
class Capture : public PanelStore {
 public:
  [[nodiscard]] std::uint32_t rows_per_panel() const override { return 64; }
  [[nodiscard]] bool has(std::uint32_t) const override { return false; }
  void read_columns(std::uint32_t, std::uint32_t, std::uint32_t, std::span<float>) const override { FAIL(); }
  [[nodiscard]] TileFacts load(std::uint32_t, FormFactorMatrix&) override { return {}; }
  void save(std::uint32_t panel, const FormFactorMatrix& s, const TileFacts&) override {
    for (std::uint32_t i = panel * 64; i < std::min(s.size(), (panel + 1) * 64); ++i) {
      rows.emplace_back(s.row(i).begin(), s.row(i).end());
    }
  }
  std::vector<std::vector<float>> rows;  ///< what lies left of the diagonal's tile is not there yet, or already
};

/// F = d S d / A with positive d: nothing negative, zeros stay zero, and A_i F_ij = A_j F_ji comes from one number.
TEST(Certificate, TheClosureKeepsSymmetryAndSigns) {
  const Builder b = with_box(true);
  const PatchMesh& mesh = b.mesh();
  AssemblyOptions options;
  options.closure = Closure::on;  // on a scene with holes and buried patches: it has to move much
  Capture capture;
  options.panels = &capture;
  const FormFactors f = assemble(mesh, options);
  ASSERT_EQ(capture.rows.size(), mesh.size());
  const std::vector<double>& d = f.report.scaling;
  double most = 0;
  for (std::uint32_t i = 0; i < mesh.size(); ++i) {
    ASSERT_GT(d[i], 0);
    most = std::max(most, std::abs(d[i] - 1));
    for (std::uint32_t j = i + 1; j < mesh.size(); ++j) {
      const float s = capture.rows[i][j];
      ASSERT_GE(f.matrix.row(i)[j], 0);
      ASSERT_EQ(f.matrix.row(i)[j] == 0, s == 0);
      ASSERT_EQ(f.matrix.row(j)[i] == 0, s == 0);
      if (s == 0) continue;
      const double scaled = static_cast<double>(s) * (d[i] * d[j]);
      EXPECT_NEAR(mesh.area[i] * static_cast<double>(f.matrix.row(i)[j]) / scaled, 1, 4e-7);
      EXPECT_NEAR(mesh.area[j] * static_cast<double>(f.matrix.row(j)[i]) / scaled, 1, 4e-7);
    }
    // Where both halves of a tile row have been written, they are the same bits.
    for (std::uint32_t j = i / 64 * 64; j < i; ++j) {
      ASSERT_EQ(std::memcmp(&capture.rows[i][j], &capture.rows[j][i], sizeof(float)), 0);
    }
  }
  EXPECT_GT(most, moved_much);
}

}  // namespace
}  // namespace interflect
