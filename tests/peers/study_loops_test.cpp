// The study's plain loop: a reference for speed has to be right as well.
#include "cli/study_loops.h"

#include <gtest/gtest.h>

#include "interflect/base/error.h"
#include "solver/reference.h"
#include "solver/room.h"

namespace interflect::cli {
namespace {

using test::relative_to_maximum;

class PlainLoop : public ::testing::TestWithParam<std::pair<VectorLayout, bool>> {
 protected:
  LoopReport solve(const FormFactorMatrix& f, const StopTest& stop, Columns& radiosity) const {
    return plain_jacobi(f, light.reflectance, light.emittance, GetParam().first, GetParam().second, stop, radiosity);
  }
  const test::Room room = test::make_room(6, 2);
  const test::Light light = test::lamp_light(room, 0.8F);
};

TEST_P(PlainLoop, AgreesWithTheReferenceSolver) {
  Columns b;
  const LoopReport report = solve(room.form_factors, StopTest{}, b);
  EXPECT_TRUE(report.converged);
  EXPECT_GT(report.iterations, 10U);
  EXPECT_GT(report.seconds, 0);
  const auto exact = test::reference_solution(room.form_factors, light.reflectance, light.emittance);
  ASSERT_EQ(b.size(), 3U);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LE(relative_to_maximum(b[c], exact[c]), 1e-5) << c;
}

TEST_P(PlainLoop, IsOneBounceForAnIteration) {
  Columns b;
  const LoopReport report = solve(room.form_factors, {.tolerance = 1e-6, .max_iterations = 3}, b);
  EXPECT_EQ(report.iterations, 3U);
  EXPECT_FALSE(report.converged);
  const auto exact = test::reference_bounces(room.form_factors, light.reflectance, light.emittance, 3);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_LE(relative_to_maximum(b[c], exact[c]), 1e-6) << c;
}

/// Twin: the bound of the first test sees a product without its last column.
TEST_P(PlainLoop, WithoutTheLastColumnIsSeen) {
  FormFactorMatrix broken = test::repanelled(room.form_factors, std::uint64_t{1} << 20);
  for (std::uint32_t i = 0; i < broken.size(); ++i) broken.row(i)[broken.size() - 1] = 0;
  Columns b;
  solve(broken, StopTest{}, b);
  const auto exact = test::reference_solution(room.form_factors, light.reflectance, light.emittance);
  for (std::size_t c = 0; c < 3; ++c) EXPECT_GT(relative_to_maximum(b[c], exact[c]), 1e-4) << c;
}

TEST_P(PlainLoop, TakesADarkChannelAndRefusesOtherShapes) {
  test::Light dark = light;
  std::fill(dark.emittance[1].begin(), dark.emittance[1].end(), 0.0F);
  Columns b;
  const LoopReport report = plain_jacobi(room.form_factors, dark.reflectance, dark.emittance, GetParam().first,
                                         GetParam().second, StopTest{}, b);
  EXPECT_TRUE(report.converged);
  EXPECT_EQ(b[1], std::vector<float>(room.form_factors.size()));
  dark.emittance[2].pop_back();
  EXPECT_THROW(static_cast<void>(plain_jacobi(room.form_factors, dark.reflectance, dark.emittance, GetParam().first,
                                              GetParam().second, StopTest{}, b)),
               Error);
}

INSTANTIATE_TEST_SUITE_P(All, PlainLoop,
                         ::testing::Values(std::pair{VectorLayout::aos, false}, std::pair{VectorLayout::aos, true},
                                           std::pair{VectorLayout::soa, false}, std::pair{VectorLayout::soa, true}),
                         [](const auto& info) {
                           return std::string(info.param.first == VectorLayout::aos ? "aos" : "soa") +
                                  (info.param.second ? "_openmp" : "_serial");
                         });

}  // namespace
}  // namespace interflect::cli
