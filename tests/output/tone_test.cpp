#include "interflect/output/tone.h"

#include <gmock/gmock.h>

#include <cmath>
#include <limits>

namespace interflect {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

TEST(SrgbTest, EncodesKnownValues) {
  EXPECT_EQ(srgb_byte(0), 0);
  EXPECT_EQ(srgb_byte(1), 255);
  EXPECT_EQ(srgb_byte(0.5), 188);
  EXPECT_EQ(srgb_byte(0.18), 118);
  EXPECT_EQ(srgb_byte(0.0031308), 10);  // where the linear part meets the power
  EXPECT_NEAR(srgb_encode(0.214041140482232), 0.5, 1e-9);
}

TEST(SrgbTest, ClampsWhatIsOutOfRange) {
  EXPECT_EQ(srgb_byte(-1), 0);
  EXPECT_EQ(srgb_byte(7), 255);
  EXPECT_EQ(srgb_byte(infinity), 255);
  EXPECT_EQ(srgb_byte(not_a_number), 0);
}

TEST(ToneCurveTest, IsMonotoneFromZeroToOne) {
  for (const ToneMap tone : {ToneMap::linear, ToneMap::filmic}) {
    EXPECT_EQ(tone_curve(0, tone), 0);
    double before = 0;
    for (double x = 1e-4; x < 1e9; x *= 1.01) {
      const double y = tone_curve(x, tone);
      ASSERT_GE(y, before) << x;
      ASSERT_LE(y, 1) << x;
      ASSERT_TRUE(y > before || x >= 0.9) << x;  // no two dark tones fall together
      before = y;
    }
    EXPECT_EQ(before, 1);
    EXPECT_EQ(tone_curve(infinity, tone), 1);
    EXPECT_EQ(tone_curve(not_a_number, tone), 0);
  }
}

TEST(ToneCurveTest, FilmicIsThePublishedFit) {
  // (x (2.51 x + 0.03)) / (x (2.43 x + 0.59) + 0.14) at x = 1: 2.54 / 3.16
  EXPECT_NEAR(tone_curve(1, ToneMap::filmic), 2.54 / 3.16, 1e-15);
  EXPECT_NEAR(tone_curve(0.5, ToneMap::filmic), 0.6425 / 1.0425, 1e-15);
}

TEST(ToneMapTest, KeepsTheHueOfBrightColours) {
  for (const ToneMap tone : {ToneMap::linear, ToneMap::filmic}) {
    for (const double exposure : {0.1, 1.0, 50.0}) {
      const Rgb shown = tone_map({0.8 * exposure, 0.4 * exposure, 0.1 * exposure}, tone);
      EXPECT_NEAR(shown[1] / shown[0], 0.5, 1e-12);
      EXPECT_NEAR(shown[2] / shown[0], 0.125, 1e-12);
      EXPECT_LE(shown[0], 1);
    }
  }
}

TEST(ToneMapTest, TakesWhatIsNotANumberAsBlack) {
  EXPECT_EQ(tone_map({not_a_number, 0.5, -1}, ToneMap::linear), (Rgb{0, 0.5, 0}));
  EXPECT_EQ(tone_map({not_a_number, infinity, -infinity}, ToneMap::filmic), (Rgb{}));
}

TEST(ExposureTest, BringsBrightSurfacesBelowWhite) {
  std::vector<Brightness> values;
  for (int k = 1; k <= 100; ++k) values.push_back({0.5 + 0.01 * k, 1});
  const double exposure = automatic_exposure(values, ToneMap::linear);
  EXPECT_NEAR(exposure * (0.5 + 0.97), 0.8, 0.02);
  for (const auto& v : values) EXPECT_LT(exposure * v.value, 1);
  for (auto& v : values) v.value *= 1000;
  EXPECT_NEAR(automatic_exposure(values, ToneMap::linear), exposure / 1000, 1e-9 * exposure);
}

TEST(ExposureTest, RaisesADarkRoomWithABrightSpot) {
  const std::vector<Brightness> values{{0.001, 90}, {1, 10}};
  const double exposure = automatic_exposure(values, ToneMap::linear);
  EXPECT_GT(exposure, 0.8 * 1.5);
  EXPECT_LE(exposure, 0.8 * 4 * (1 + 1e-12));
}

TEST(ExposureTest, IsOneWhenNothingIsLit) {
  EXPECT_EQ(automatic_exposure({}, ToneMap::filmic), 1);
  EXPECT_EQ(automatic_exposure({{0, 1}, {-1, 1}, {not_a_number, 1}, {infinity, 1}, {1, 0}}, ToneMap::filmic), 1);
}

}  // namespace
}  // namespace interflect
