// Exposure, tone curves and false colours: the same rules as host/output/tone.h.

/** The curve on x >= 0: "linear", or "filmic" (K. Narkowicz, "ACES Filmic Tone Mapping Curve", 2015). */
function toneCurve(x, tone) {
  if (!(x > 0)) return 0;
  if (tone === "linear") return Math.min(x, 1);
  if (x > 1e6) return 1;
  return Math.min(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1);
}

const srgbDecode = (v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;

/** Linear channels of "#rrggbb". */
function linearOfHex(hex) {
  return [1, 3, 5].map((at) => srgbDecode(parseInt(hex.slice(at, at + 2), 16) / 255));
}

const luminance = (r, g, b) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

/**
 * The exposure that brings the 97th percentile (by weight) of the values to where the curve gives 0.8, raised by up to 4
 * where the logarithmic mean would stay below 0.06. `values`: pairs [brightness, weight].
 */
function automaticExposure(values, tone) {
  const good = values.filter(([v, w]) => v > 0 && Number.isFinite(v) && w > 0).sort((a, b) => a[0] - b[0]);
  if (good.length === 0) return 1;
  const total = good.reduce((sum, [, w]) => sum + w, 0);
  const logarithms = good.reduce((sum, [v, w]) => sum + w * Math.log(v), 0);
  const exposure = (tone === "linear" ? 0.8 : 1) / percentile(good, 0.97);
  const mean = exposure * Math.exp(logarithms / total);
  return exposure * Math.min(Math.max(0.06 / mean, 1), 4);
}

/** The value below which a share of the weight lies; pairs [value, weight] in rising order. */
function percentile(sorted, share) {
  const total = sorted.reduce((sum, [, w]) => sum + w, 0);
  let below = 0;
  for (const [value, weight] of sorted) {
    below += weight;
    if (below >= share * total) return value;
  }
  return sorted[sorted.length - 1][0];
}

/** From low to high, evenly spaced, sRGB; what lies above the scale is white. */
const ramp = ["#14123a", "#26348f", "#1f6fc0", "#1b9fb0", "#35b779", "#9bcb3c", "#ecc52e", "#f0852b", "#d43a2c"];
const overRange = "#ffffff";

/** The next of 1, 2, 5 times a power of ten that is not below a value. */
function niceAbove(value) {
  if (!(value > 0) || !Number.isFinite(value)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return [1, 2, 5, 10].map((m) => m * power).find((v) => v >= value * 0.9999999);
}

/** Where the legend has ticks: values within the scale. */
function ticksOf(scale) {
  const ticks = [];
  if (scale.kind === "log") {
    const decades = Math.log10(scale.high / scale.low);
    const steps = decades > 4 ? [1] : decades > 2.5 ? [1, 3] : decades > 1 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 8];
    for (let power = Math.floor(Math.log10(scale.low)); power <= Math.log10(scale.high) + 1e-9; ++power) {
      for (const step of steps) {
        const value = step * 10 ** power;
        if (value >= scale.low * 0.999999 && value <= scale.high * 1.000001) ticks.push(value);
      }
    }
    return ticks;
  }
  const span = scale.high - scale.low;
  const rough = span / 6, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 2.5, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.9999999);
  for (let k = Math.ceil(scale.low / step - 1e-9); k * step <= scale.high + 1e-9 * span; ++k) ticks.push(k * step);
  return ticks;
}

/** Where a value lies on the scale: 0 at its foot, 1 at its top. */
function placeOn(scale, value) {
  if (scale.kind === "log") return Math.log(value / scale.low) / Math.log(scale.high / scale.low);
  return (value - scale.low) / (scale.high - scale.low);
}

/** A number for people: at most `digits` significant ones. */
function shown(value, digits = 4) {
  if (!Number.isFinite(value)) return "not a number";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(digits - 1).replace(/\.?0+e/, "e");
  return String(Number(value.toPrecision(digits)));
}
