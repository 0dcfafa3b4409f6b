// What is known of one patch.

class Inspector {
  constructor(data, light) {
    this.data = data;
    this.light = light;
    this.list = document.getElementById("inspect");
    this.none = document.getElementById("inspect-none");
    this.surface = data.section("surface");
    this.lamp = data.section("lamp");
    this.reflectance = data.section("reflectance");
    this.emittance = data.section("emittance");
    this.rowSum = data.section("row_sum");
  }

  /** The light group of a patch, or -1. A solution without groups is one lamp. */
  lampOf(patch) {
    if (!this.lamp) return this.emits(patch) ? 0 : -1;
    const g = this.lamp[patch];
    return g < this.data.lamps.length ? g : -1;
  }

  emits(patch) {
    return Math.max(...this.emittance.subarray(3 * patch, 3 * patch + 3)) > 0;
  }

  /** Writes the numbers of a patch as it is lit with these weights; none for -1. A line for those who listen. */
  show(patch, weights) {
    this.list.hidden = patch < 0;
    this.none.hidden = patch >= 0;
    if (patch < 0) return "";
    const three = (values) => Array.from(values, (v) => shown(v, 5)).join("  ");
    const at = (values) => values.subarray(3 * patch, 3 * patch + 3);
    const [object, material] = this.data.surfaces[this.surface[patch]];
    const g = this.lampOf(patch);
    const emittance = Array.from(at(this.emittance), (e, c) => g >= 0 ? e * weights[g][c] : e);
    const radiosity = at(this.light.radiosity);
    const entries = [
      ["object", "Object", object || "(no name)"],
      ["material", "Material", material || "(no name)"],
      ["lamp", "Lamp", g >= 0 ? this.data.lamps[g] : null],
      ["patch", "Patch", `${patch} of ${this.data.patches}`],
      ["area", "Area A", shown(this.light.area[patch], 5)],
      ["reflectance", "Reflectance ρ", three(at(this.reflectance))],
      ["emittance", "Emittance E", three(emittance)],
      ["radiosity", "Radiosity B", three(radiosity)],
      ["weighted", "B, weighted", shown(luminance(...radiosity), 5)],
      ["row-sum", "Row sum Σ F", shown(this.rowSum[patch], 6)],
    ];
    this.list.replaceChildren(...entries.filter(([, , text]) => text !== null).flatMap(([id, label, text]) => {
      const term = document.createElement("dt"), value = document.createElement("dd");
      term.textContent = label;
      value.textContent = text;
      value.id = `inspect-${id}`;
      return [term, value];
    }));
    return `${object || "no name"}, ${material || "no material"}: radiosity ${three(radiosity)}`;
  }
}
