// A row per lamp: name, switch, slider and colour.

const asInScene = () => ({on: true, level: 1, colour: "#ffffff"});

/** The weights [G][3] that the rows mean. */
function weightsOf(lamps) {
  return lamps.map(({on, level, colour}) => on ? linearOfHex(colour).map((c) => c * level) : [0, 0, 0]);
}

class LampRows {
  /** `lamps`: the rows' state, changed in place; `changed` is called after each change. */
  constructor(names, lamps, changed) {
    this.lamps = lamps;
    this.rows = names.map((name, g) => this.row(name || `Lamp ${g + 1}`, g, changed));
    document.getElementById("lamps").append(...this.rows.map((row) => row.element));
    const all = (id, change) => document.getElementById(id).addEventListener("click", () => {
      this.lamps.forEach(change);
      this.show();
      changed();
    });
    all("all-on", (lamp) => lamp.on = true);
    all("all-off", (lamp) => lamp.on = false);
    all("lamps-reset", (lamp) => Object.assign(lamp, asInScene()));
    this.show();
  }

  row(name, g, changed) {
    const element = document.createElement("div");
    element.className = "lamp";
    element.setAttribute("role", "group");
    element.setAttribute("aria-label", name);
    const input = (type, label, event, read) => {
      const made = document.createElement("input");
      made.type = type;
      made.setAttribute("aria-label", `${name}: ${label}`);
      made.addEventListener(event, () => {
        read(made);
        this.show();
        changed();
      });
      return made;
    };
    const lamp = this.lamps[g];
    const on = input("checkbox", "on", "change", (i) => lamp.on = i.checked);
    on.setAttribute("role", "switch");
    const level = input("range", "brightness in percent", "input", (i) => {
      lamp.level = Number(i.value) / 100;
      lamp.on = true;
    });
    [level.min, level.max, level.step] = [0, 200, 1];
    const colour = input("color", "colour filter", "input", (i) => lamp.colour = i.value);
    colour.title = "Colour filter: white leaves the lamp as it is in the scene";
    const label = document.createElement("span");
    label.className = "name";
    label.textContent = name;
    label.title = name;
    const value = document.createElement("output");
    const head = document.createElement("div");
    head.className = "row";
    head.append(on, label, value, colour);
    element.append(head, level);
    return {element, on, level, colour, value};
  }

  show() {
    this.rows.forEach(({element, on, level, colour, value}, g) => {
      const lamp = this.lamps[g];
      on.checked = lamp.on;
      level.value = Math.round(100 * lamp.level);
      colour.value = lamp.colour;
      value.textContent = lamp.on ? `${Math.round(100 * lamp.level)} %` : "off";
      element.classList.toggle("off", !lamp.on);
      fillTrack(level);
    });
  }

  /** Points at a lamp's row. */
  mark(g) {
    this.rows.forEach(({element}, k) => element.classList.toggle("marked", k === g));
  }
}

/** Colours a slider's track up to its thumb. */
function fillTrack(slider) {
  const share = (slider.value - slider.min) / (slider.max - slider.min || 1);
  slider.style.setProperty("--fill", `${100 * share}%`);
}
