// A page that `interflect serve` handed out: walls and lamps change, and the solver behind it answers with new light.

const tolerances = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6];

/** A row for a material: its colour, how much of the light it reflects, and what it emits. */
class MaterialRow {
  constructor(material, changed) {
    this.material = material;
    this.changed = changed;
    this.reset();
    this.element = document.createElement("div");
    this.element.className = "lamp material";
    this.element.setAttribute("role", "group");
    this.element.setAttribute("aria-label", material.name);
    const label = document.createElement("span");
    label.className = "name";
    label.textContent = label.title = material.name;
    this.value = document.createElement("output");
    this.colour = this.input("color", "colour", (input) => this.paint(linearOfHex(input.value)));
    this.colour.title = "Reflectance per channel, as a colour";
    this.level = this.input("range", "reflectance in percent", (input) => this.reflect(Number(input.value) / 100));
    [this.level.min, this.level.max, this.level.step] = [0, 100, 0.5];
    const head = document.createElement("div");
    head.className = "row";
    head.append(label, this.value, this.colour);
    this.element.append(head, this.level);
    if (material.emittance) this.element.append(this.emitting());
    this.show();
  }

  input(type, label, read, event = "input") {
    const made = document.createElement("input");
    made.type = type;
    made.setAttribute("aria-label", `${this.material.name}: ${label}`);
    made.addEventListener(event, () => {
      read(made);
      this.show();
      this.changed();
    });
    return made;
  }

  emitting() {
    const row = document.createElement("div"), label = document.createElement("span");
    row.className = "row fields";
    label.textContent = "Emits";
    this.fields = ["red", "green", "blue"].map((name, c) => {
      const field = this.input("number", `emittance, ${name}`, (input) => {
        const value = Number(input.value);
        if (input.value !== "" && value >= 0 && value <= 1e9) this.emittance[c] = value;
      }, "change");
      [field.min, field.step] = [0, "any"];
      return field;
    });
    row.append(label, ...this.fields);
    return row;
  }

  reset() {
    this.reflectance = [...this.material.reflectance];
    this.emittance = this.material.emittance ? [...this.material.emittance] : null;
    this.hue = MaterialRow.hueOf(this.reflectance);
  }

  /** The colour at full reflectance; white for black. */
  static hueOf(reflectance) {
    const largest = Math.max(...reflectance);
    return reflectance.map((v) => largest > 0 ? v / largest : 1);
  }

  paint(colour) {
    this.reflectance = colour.map((v) => Math.max(0, Math.min(1, v)));
    if (Math.max(...colour) > 0) this.hue = MaterialRow.hueOf(this.reflectance);
  }

  reflect(level) {
    this.reflectance = this.hue.map((v) => Math.max(0, Math.min(1, v * level)));
  }

  show() {
    const level = Math.max(...this.reflectance);
    this.level.value = 100 * level;
    fillTrack(this.level);
    this.value.textContent = `${Math.round(100 * level)} %`;
    this.colour.value = hexOfLinear(this.reflectance);
    if (this.fields) this.fields.forEach((field, c) => field.value = Number(this.emittance[c].toPrecision(6)));
  }

  /** Adds to a request what is not as in the scene. */
  report(request) {
    const same = (a, b) => a.every((v, c) => v === b[c]);
    const {name, reflectance, emittance} = this.material;
    if (!same(this.reflectance, reflectance)) request.reflectance[name] = this.reflectance;
    if (emittance && !same(this.emittance, emittance)) request.emittance[name] = this.emittance;
  }
}

/** "#rrggbb" in sRGB of a linear colour within 0..1. */
function hexOfLinear(colour) {
  const encode = (v) => v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055;
  return "#" + colour.map((v) => Math.round(255 * encode(v)).toString(16).padStart(2, "0")).join("");
}

/** What a solve answers: see solution_bytes(). */
function readSolution(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const solution = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const count = 3 * solution.patches;
  solution.lit = Array.from({length: solution.lamps}, (_, g) => new Float32Array(buffer, 4 + length + 4 * count * g, count));
  return solution;
}

class Live {
  constructor(app) {
    this.app = app;
    this.client = Array.from(crypto.getRandomValues(new Uint8Array(12)), (b) => b.toString(16).padStart(2, "0")).join("");
    this.rows = [];
    this.times = [];
    this.wanted = this.busy = false;
    byId("bounces").hidden = true;  // they were the first solution's
    document.querySelector("#help .note").textContent =
      "Lamps on their sliders scale light that is solved. Surfaces, what a lamp emits and the tolerance are solved anew by the program that serves this page.";
    this.begin();
  }

  async begin() {
    try {
      this.scene = await this.get("/scene");
      this.scene.materials.sort((a, b) => b.area - a.area);  // walls first
      this.build();
      document.documentElement.dataset.live = "1";
      this.listDevices(await this.get("/devices"));
    } catch (error) {
      this.app.panel.say(`The solver does not answer: ${error.message}`);
    }
  }

  async get(path) {
    let answer = await fetch(path);
    while (answer.status === 503) {  // many are here: their turns come
      await this.pause(answer);
      answer = await fetch(path);
    }
    if (!answer.ok) throw new Error((await answer.json()).error);
    return answer.json();
  }

  post(path, body) {
    return fetch(path, {method: "POST", headers: {"Content-Type": "application/json"}, body: JSON.stringify(body)});
  }

  /** For as long as a server that is busy asks for. */
  pause(answer) {
    return new Promise((done) => setTimeout(done, 1000 * (Number(answer.headers.get("Retry-After")) || 1)));
  }

  build() {
    const {data} = this.app;
    this.ofSurface = new Map(this.scene.materials.flatMap((m, k) => m.surfaces.map((s) => [s, k])));
    this.surface = data.section("surface");
    this.base = {reflectance: data.section("reflectance").slice(), emittance: data.section("emittance").slice()};
    this.rows = this.scene.materials.map((material) => new MaterialRow(material, () => this.change()));
    this.buildSurfaces();
    this.buildSolver();
    const {app} = this, inspect = app.inspect.bind(app);
    app.inspect = (patch) => {
      inspect(patch);
      this.mark(patch);
    };
  }

  /** An open section of the panel below `after`. */
  section(id, title, after) {
    const details = document.createElement("details"), summary = document.createElement("summary");
    details.id = id;
    details.open = true;
    summary.textContent = title;
    details.append(summary);
    after.after(details);
    return details;
  }

  buildSurfaces() {
    const section = this.section("surfaces", "Surfaces", byId("lamps").closest("details"));
    const reset = document.createElement("button"), row = document.createElement("div");
    reset.id = "surfaces-reset";
    reset.type = "button";
    reset.textContent = "As in the scene";
    reset.addEventListener("click", () => {
      this.rows.forEach((r) => {
        r.reset();
        r.show();
      });
      this.change();
    });
    row.className = "row spread";
    row.append(reset);
    section.append(...this.rows.map((r) => r.element), row);
  }

  buildSolver() {
    const section = this.section("solver", "Solver", byId("lamps").closest("details"));
    const choice = (id, label) => {
      const row = document.createElement("div"), name = document.createElement("label"), select = document.createElement("select");
      row.className = "row";
      name.htmlFor = select.id = id;
      name.textContent = label;
      row.append(name, select);
      section.append(row);
      return select;
    };
    this.device = choice("device", "Device");
    this.device.add(new Option(this.scene.device, this.scene.device, true, true));
    this.device.addEventListener("change", () => this.chooseDevice(this.device.value));
    this.tolerance = choice("tolerance", "Tolerance");
    const all = [...new Set([...tolerances, this.scene.tolerance])].sort((a, b) => b - a);
    all.forEach((t) => this.tolerance.add(new Option(t.toExponential(), t, false, t === this.scene.tolerance)));
    this.tolerance.addEventListener("change", () => this.change());
    this.problem = document.createElement("p");
    this.problem.className = "note problem";
    this.problem.setAttribute("role", "alert");
    this.problem.hidden = true;
    this.numbers = document.createElement("dl");
    section.append(this.problem, this.numbers);
    this.tell([["", "Storage", this.scene.storage]]);
    this.sayWhere(this.scene.device);
  }

  tell(entries) {
    this.numbers.replaceChildren(...entries.flatMap(([id, label, text]) => {
      const term = document.createElement("dt"), value = document.createElement("dd");
      term.textContent = label;
      value.textContent = text;
      if (id) value.id = id;
      return [term, value];
    }));
  }

  sayWhere(device) {
    const {data} = this.app, count = data.lamps.length;
    byId("subtitle").textContent = `${data.patches.toLocaleString("en")} patches · ${count} ${count === 1 ? "lamp" : "lamps"} · live on ${device}`;
  }

  listDevices(devices) {
    this.device.replaceChildren(...devices.map((d) => {
      const option = new Option(`${d.id} · ${d.name}${d.emulated ? " (emulated)" : ""}`, d.id, d.used, d.used);
      option.disabled = !d.available;
      option.title = d.available ? d.name : d.reason;
      return option;
    }));
  }

  /** A device that fails is said so, and the old one stays. */
  async chooseDevice(id) {
    this.device.disabled = true;
    this.app.panel.say(`Moving to ${id} …`);
    try {
      const answer = await this.post("/device", {device: id});
      const said = await answer.json();
      if (!answer.ok) throw new Error(said.error);
      this.scene.device = said.device;
      this.complain("");
      this.sayWhere(said.device);
      this.times = [];
      this.change();
    } catch (error) {
      this.complain(error.message);
    }
    this.device.value = this.scene.device;
    this.device.disabled = false;
  }

  complain(text) {
    this.problem.textContent = text;
    this.problem.hidden = text === "";
  }

  /** Something has changed. One solve is on its way at a time; what changes meanwhile is asked for once it is back. */
  change() {
    this.wanted = true;
    if (!this.busy) this.ask();
  }

  async ask() {
    this.busy = true;
    while (this.wanted) {
      this.wanted = false;
      const request = {client: this.client, tolerance: Number(this.tolerance.value),
        reflectance: Object.create(null), emittance: Object.create(null)};
      this.rows.forEach((row) => row.report(request));
      try {
        const again = await this.solve(request);
        this.wanted = this.wanted || again;
      } catch (error) {
        this.complain(`The solver does not answer (${error.message}); asking again …`);
        this.wanted = true;
        await new Promise((done) => setTimeout(done, 2000));
      }
    }
    this.busy = false;
  }

  /** Whether to ask again. */
  async solve(request) {
    const began = performance.now();
    const answer = await this.post("/solve", request);
    if (answer.status === 503) {
      await this.pause(answer);
      return true;
    }
    if (!answer.ok) {
      this.complain((await answer.json()).error);
      return false;
    }
    const solution = readSolution(await answer.arrayBuffer());
    const {data} = this.app;
    if (solution.patches !== data.patches || solution.lamps !== data.lamps.length) {
      this.complain("Another scene is served at this address now: load the page again.");
      return false;
    }
    this.show(solution, request, performance.now() - began);
    return false;
  }

  show(solution, request, milliseconds) {
    const {app} = this;
    app.light.lit = solution.lit;
    this.repaint("reflectance", request.reflectance, 1);
    this.repaint("emittance", request.emittance, Infinity);
    app.relight();
    this.times = [...this.times, solution.seconds].slice(-10);
    const mean = this.times.reduce((sum, t) => sum + t, 0) / this.times.length;
    const residual = Math.max(...solution.relative_residual.map((r) => r === null ? Infinity : r));
    this.tell([
      ["rate", "Solves per second", shown(1 / mean, 3)],
      ["solve-time", "Last solve", `${shown(1000 * solution.seconds, 3)} ms`],
      ["products", "Products", `${solution.products}${solution.warm ? "" : ", from nothing"}`],
      ["residual", "Residual", Number.isFinite(residual) ? residual.toExponential(1) : "not a number"],
      ["round-trip", "With the way here", `${shown(milliseconds, 3)} ms`],
      ["storage", "Storage", solution.storage + (solution.rounding_error ? `, within ${solution.rounding_error.toExponential(1)}` : "")],
    ]);
    if (solution.device !== this.scene.device) {
      this.scene.device = this.device.value = solution.device;
      this.sayWhere(solution.device);
    }
    this.complain(solution.notice || (solution.converged ? "" : `Not converged: ${solution.reason}`));
    document.documentElement.dataset.solved = solution.number;
  }

  /** The patches' own values, for the inspector: as LiveScene makes them. */
  repaint(what, wanted, most) {
    const values = this.app.data.section(what), base = this.base[what], {materials} = this.scene;
    for (let i = 0; i < this.surface.length; ++i) {
      const material = materials[this.ofSurface.get(this.surface[i])], now = material && wanted[material.name];
      const emits = what === "reflectance" || base[3 * i] > 0 || base[3 * i + 1] > 0 || base[3 * i + 2] > 0;
      for (let c = 0, k = 3 * i; c < 3; ++c, ++k) {
        values[k] = base[k];
        if (!now || !emits) continue;
        const mean = material[what][c];
        values[k] = Math.min(most, material.varies && mean > 0 ? base[k] * now[c] / mean : now[c]);
      }
    }
  }

  /** Points at the row of a patch's material. */
  mark(patch) {
    const k = patch >= 0 ? this.ofSurface.get(this.surface[patch]) : -1;
    this.rows.forEach((row, r) => row.element.classList.toggle("marked", r === k));
    if (this.rows[k]) this.rows[k].element.scrollIntoView({block: "nearest"});
  }
}
