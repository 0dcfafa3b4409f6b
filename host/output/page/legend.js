// The false colours' scale and its legend.

class Legend {
  constructor(light, data) {
    this.light = light;
    this.emittance = data.section("emittance");
    this.element = document.getElementById("legend");
    this.bar = document.getElementById("legend-bar");
    this.ticks = document.getElementById("legend-ticks");
    this.bar.style.background = `linear-gradient(to top, ${ramp.join(", ")})`;
  }

  /** A scale for the surfaces as they are lit: its top is a round number that 98 % of the area without lamps stay below. */
  fit(kind) {
    const {radiosity, area, patches} = this.light;
    const values = [];
    for (let i = 0; i < patches; ++i) {
      const at = 3 * i;
      if (Math.max(this.emittance[at], this.emittance[at + 1], this.emittance[at + 2]) > 0) continue;
      const y = luminance(radiosity[at], radiosity[at + 1], radiosity[at + 2]);
      if (y > 0 && Number.isFinite(y)) values.push([y, area[i]]);
    }
    values.sort((a, b) => a[0] - b[0]);
    const high = values.length > 0 ? niceAbove(percentile(values, 0.98)) : 1;
    return {kind, low: kind === "log" ? high / 100 : 0, high};
  }

  show(scale, visible) {
    this.element.hidden = !visible;
    if (!visible) return;
    this.ticks.replaceChildren(...ticksOf(scale).map((value) => {
      const tick = document.createElement("span");
      tick.textContent = shown(value, 3);
      tick.style.bottom = `${100 * placeOn(scale, value)}%`;
      return tick;
    }));
  }

  /** Draws the legend into a picture's lower left corner. */
  paint(canvas, scale, pixelRatio) {
    const pen = canvas.getContext("2d");
    pen.scale(pixelRatio, pixelRatio);
    const height = Math.min(220, canvas.height / pixelRatio - 80), top = canvas.height / pixelRatio - height - 24;
    pen.fillStyle = "rgba(20, 22, 26, 0.8)";
    pen.fillRect(12, top - 36, 104, height + 48);
    const gradient = pen.createLinearGradient(0, top + height, 0, top);
    ramp.forEach((colour, k) => gradient.addColorStop(k / (ramp.length - 1), colour));
    pen.fillStyle = gradient;
    pen.fillRect(24, top, 14, height);
    pen.fillStyle = "#ffffff";
    pen.font = "12px system-ui, sans-serif";
    pen.fillText("Radiosity", 24, top - 16);
    for (const value of ticksOf(scale)) {
      const y = top + height * (1 - placeOn(scale, value));
      pen.fillRect(38, y - 0.5, 4, 1);
      pen.fillText(shown(value, 3), 46, y + 4);
    }
  }
}
