// The light: a solution is linear in its lamps, B = sum over g of w_g B_g, with a weight per channel.

class Light {
  constructor(data) {
    this.data = data;
    this.patches = data.patches;
    this.lamps = data.lamps.length;
    this.bounces = data.bounces;  // how many are known; `bounce === bounces` stands for all of them
    this.lit = data.lamps.map((_, g) => data.section(`lit.${g}`));
    this.corners = data.section("smooth_corners");
    this.hanging = data.section("hanging");
    this.area = data.section("area");
    this.vertices = this.corners.reduce((most, v) => Math.max(most, v), 0) + 1;
    this.radiosity = new Float32Array(3 * this.patches);
    this.values = new Float32Array(3 * this.vertices);
    this.areas = new Float32Array(this.vertices);
  }

  /** What lamp g gives each patch after `bounce` bounces, as a function of the index into [N][3]. */
  reader(g, bounce) {
    if (bounce >= this.bounces) {
      const lit = this.lit[g];
      return (i) => lit[i];
    }
    this.halves = this.halves || halfValues();
    const bits = this.data.section(`bounce.${bounce}.${g}`), halves = this.halves, unit = this.data.bounce_unit;
    return (i) => halves[bits[i]] * unit;
  }

  /** Computes `radiosity` for weights [G][3]. */
  mix(weights, bounce) {
    const out = this.radiosity;
    out.fill(0);
    for (let g = 0; g < this.lamps; ++g) {
      const [r, green, b] = weights[g];
      if (r === 0 && green === 0 && b === 0) continue;
      const read = this.reader(g, bounce);
      for (let i = 0; i < out.length; i += 3) {
        out[i] += r * read(i);
        out[i + 1] += green * read(i + 1);
        out[i + 2] += b * read(i + 2);
      }
    }
  }

  /** The radiosity at every corner of every patch, [N][3][3]: the patch's own, or smooth as host/output/smooth.h. */
  fill(colours, smooth) {
    if (smooth) this.smooth();
    const flat = this.radiosity;
    for (let k = 0, i = 0; k < this.corners.length; ++k) {
      const from = smooth ? 3 * this.corners[k] : 3 * Math.floor(k / 3);
      const values = smooth ? this.values : flat;
      for (let c = 0; c < 3; ++c, ++i) colours[i] = Math.max(values[from + c], 0) || 0;  // NaN shows black
    }
  }

  /** Area-weighted means at the smooth vertices, then the hanging ones from the ends of their edges. */
  smooth() {
    const {values, areas, corners, radiosity, hanging} = this;
    values.fill(0);
    areas.fill(0);
    for (let patch = 0; patch < this.patches; ++patch) {
      const r = radiosity[3 * patch], g = radiosity[3 * patch + 1], b = radiosity[3 * patch + 2];
      if (!Number.isFinite(r + g + b)) continue;
      const area = this.area[patch];
      for (let k = 3 * patch; k < 3 * patch + 3; ++k) {
        const v = corners[k];
        values[3 * v] += area * r;
        values[3 * v + 1] += area * g;
        values[3 * v + 2] += area * b;
        areas[v] += area;
      }
    }
    for (let v = 0; v < areas.length; ++v) {
      for (let c = 3 * v; c < 3 * v + 3; ++c) values[c] = areas[v] > 0 ? values[c] / areas[v] : 0;
    }
    for (let h = 0; h < hanging.length; h += 3) {
      for (let c = 0; c < 3; ++c) {
        values[3 * hanging[h] + c] = 0.5 * (values[3 * hanging[h + 1] + c] + values[3 * hanging[h + 2] + c]);
      }
    }
  }
}
