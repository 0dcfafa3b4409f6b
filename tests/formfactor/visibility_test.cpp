#include "interflect/formfactor/visibility.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace interflect {
namespace {

const std::vector<Vec3> corners{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
const std::vector<std::array<std::uint32_t, 3>> one{{0, 1, 2}};

TEST(Visibility, TheNearestHitTellsFrontFromBack) {
  const Visibility scene(corners, one);
  const auto from_above = scene.closest({{0.25F, 0.25F, 2}, 0, {0, 0, -1}, 10});
  ASSERT_TRUE(from_above.has_value());
  EXPECT_TRUE(from_above->front) << "counter-clockwise seen from +z";
  EXPECT_FLOAT_EQ(from_above->t, 2);
  EXPECT_FLOAT_EQ(from_above->u, 0.25F);
  const auto from_below = scene.closest({{0.25F, 0.25F, -2}, 0, {0, 0, 1}, 10});
  ASSERT_TRUE(from_below.has_value());
  EXPECT_FALSE(from_below->front);
  EXPECT_FALSE(scene.closest({{2, 2, 2}, 0, {0, 0, -1}, 10}).has_value());
  EXPECT_FALSE(scene.closest({{0.25F, 0.25F, 2}, 0, {0, 0, -1}, 1.5F}).has_value()) << "beyond far";
}

TEST(Visibility, StreamsLongerThanABatchAndBothSidesBlock) {
  const Visibility scene(corners, one);
  constexpr std::size_t count = 3000;
  std::vector<Visibility::Ray> rays;
  for (std::size_t k = 0; k < count; ++k) {
    const float x = k % 3 == 0 ? 0.25F : 5;
    const float z = k % 2 == 0 ? 1.0F : -1.0F;
    rays.push_back({{x, 0.25F, z}, 0, {0, 0, -2 * z}, 1});
  }
  const auto hidden = std::make_unique<bool[]>(count);
  scene.occluded(rays, {hidden.get(), count});
  for (std::size_t k = 0; k < count; ++k) ASSERT_EQ(hidden[k], k % 3 == 0) << k;
}

TEST(Visibility, NothingBlocksInAnEmptyScene) {
  const Visibility scene({}, {});
  EXPECT_FALSE(scene.closest({{0, 0, 0}, 0, {0, 0, 1}, 10}).has_value());
}

}  // namespace
}  // namespace interflect
