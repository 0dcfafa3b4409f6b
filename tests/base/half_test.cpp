#include "interflect/base/half.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace interflect {
namespace {

/// A half's value by the standard's definition.
double value_of(std::uint32_t half) {
  const double sign = (half & 0x8000U) != 0 ? -1 : 1;
  const int exponent = static_cast<int>(half >> 10U & 31U);
  const double fraction = static_cast<double>(half & 1023U) / 1024;
  if (exponent == 31) return sign * std::numeric_limits<double>::infinity();
  return exponent == 0 ? sign * std::ldexp(fraction, -14) : sign * std::ldexp(1 + fraction, exponent - 15);
}

TEST(Half, EveryFiniteOneHasItsValueAndComesBack) {
  for (std::uint32_t half = 0; half < 0x10000U; ++half) {
    if ((half & 0x7FFFU) > 0x7C00U) continue;  // not a number
    const float value = from_half(static_cast<Half>(half));
    ASSERT_EQ(static_cast<double>(value), value_of(half)) << half;
    ASSERT_EQ(std::signbit(value), half >= 0x8000U) << half;
    ASSERT_EQ(to_half(value), half);
  }
}

TEST(Half, RoundsToTheNearestAndTiesToEven) {
  for (std::uint32_t half = 0; half + 1 < 0x7C00U; ++half) {
    const auto low = static_cast<float>(value_of(half)), high = static_cast<float>(value_of(half + 1));
    const float middle = (low + high) / 2;  // exact
    ASSERT_EQ(to_half(middle), half % 2 == 0 ? half : half + 1) << half;
    ASSERT_EQ(to_half(std::nextafter(middle, 0.0F)), half) << half;
    ASSERT_EQ(to_half(std::nextafter(middle, 1e9F)), half + 1) << half;
    ASSERT_EQ(to_half(-middle), (half % 2 == 0 ? half : half + 1) | 0x8000U) << half;
  }
}

TEST(Half, TooLargeIsInfinite) {
  EXPECT_EQ(to_half(65504.0F), 0x7BFFU);
  EXPECT_EQ(to_half(std::nextafter(65520.0F, 0.0F)), 0x7BFFU);
  EXPECT_EQ(to_half(65520.0F), 0x7C00U);
  EXPECT_EQ(to_half(1e30F), 0x7C00U);
  EXPECT_EQ(to_half(std::numeric_limits<float>::denorm_min()), 0U);
}

}  // namespace
}  // namespace interflect
