#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "interflect/base/vec3.h"
#include "interflect/output/output.h"

namespace interflect {

/// The tone curve for x >= 0; monotone, tone_curve(0) = 0, at most 1.
///   linear: min(x, 1)
///   filmic: x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14), at most 1: K. Narkowicz, "ACES Filmic Tone Mapping Curve"
///           (2015), a fit of the Academy's reference transform.
[[nodiscard]] double tone_curve(double x, ToneMap tone);

/// Exposed radiosity to what the screen shows, linear, 0..1: the curve is applied to the largest channel and the others
/// keep their ratio to it, so that the hue stays. Channels that are negative or not finite count as 0.
[[nodiscard]] Rgb tone_map(Rgb exposed, ToneMap tone);

/// The sRGB transfer function of IEC 61966-2-1: linear 0..1 (clamped) to 0..1.
[[nodiscard]] double srgb_encode(double linear);

/// srgb_encode() as a byte, rounded to nearest: 0.5 gives 188.
[[nodiscard]] std::uint8_t srgb_byte(double linear);

/// A brightness (largest channel) with the area, in any unit, over which it is seen.
struct Brightness {
  double value = 0;
  double weight = 0;
};

/// The exposure that uses the screen's range: brings the 97th percentile (by weight) of the values to where the curve
/// gives 0.8, but raises a picture whose logarithmic mean would stay below 0.06 (few bright spots in a dark room), by a
/// factor of 4 at most. Values that are not finite and positive do not count; 1 when none are left.
[[nodiscard]] double automatic_exposure(std::vector<Brightness> values, ToneMap tone);

/// automatic_exposure() of all surfaces that are not lamps, by area, for the linear curve: for files that are looked at
/// from anywhere.
[[nodiscard]] double surface_exposure(const PatchMesh& mesh, const std::vector<Rgb>& radiosity);

/// The factor from radiosity to the colours within 0..1 that files for screens hold: 1 when all radiosities are within
/// 0..1 and not very dark, else surface_exposure().
[[nodiscard]] double color_scale(const PatchMesh& mesh, const std::vector<Rgb>& radiosity);

/// The largest channel, 0 at least; channels that are not finite count as 0.
[[nodiscard]] double brightness(const Rgb& colour);

/// Whether a patch counts as a lamp for exposure and smoothing.
[[nodiscard]] bool emits(const Rgb& emittance);

}  // namespace interflect
