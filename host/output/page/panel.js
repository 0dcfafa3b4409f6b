// The panel and the buttons: each control shows the state and changes it.

class Panel {
  constructor(app) {
    this.app = app;
    const {data} = app;
    byId("title").textContent = data.title;
    byId("subtitle").textContent = [`${data.patches.toLocaleString("en")} patches`,
      `${data.lamps.length} ${data.lamps.length === 1 ? "lamp" : "lamps"}`].join(" · ");
    byId("statistics").replaceChildren(...data.statistics.flatMap(([name, value]) => {
      const term = document.createElement("dt"), text = document.createElement("dd");
      term.textContent = name;
      text.textContent = value;
      return [term, text];
    }));
    this.lamps = new LampRows(data.lamps, app.state.lamps, () => app.relight());
    this.display();
    this.bounces();
    this.buttons();
    this.theme();
    this.folding();
    this.keys();
    this.guides();
    window.addEventListener("resize", () => this.layout());
  }

  display() {
    const {app} = this, {state} = app;
    const changed = () => {
      this.show();
      app.view.request();
    };
    const radios = (name, change) => document.getElementsByName(name).forEach((radio) => {
      radio.addEventListener("change", () => {
        change(radio.value);
        changed();
      });
    });
    radios("tone", (value) => state.tone = value);
    radios("scale", (value) => state.scale = app.legend.fit(value));
    radios("camera", (value) => app.walker.mode = value);
    byId("exposure").addEventListener("input", (e) => {
      state.exposure = Number(e.target.value);
      changed();
    });
    byId("exposure-auto").addEventListener("click", () => {
      app.exposeAutomatically();
      changed();
    });
    byId("scale-fit").addEventListener("click", () => {
      state.scale = app.legend.fit(state.scale.kind);
      changed();
    });
    for (const end of ["low", "high"]) {
      byId(`scale-${end}`).addEventListener("change", (e) => {
        const wanted = {...state.scale, [end]: Number(e.target.value)};
        if (isScale(wanted.kind, wanted.low, wanted.high)) state.scale = wanted;
        changed();
      });
    }
    byId("smooth").addEventListener("change", (e) => {
      state.smooth = e.target.checked;
      app.stale.colours = true;
      changed();
    });
    byId("wire").addEventListener("change", (e) => {
      state.wire = e.target.checked;
      changed();
    });
  }

  bounces() {
    const {app} = this, {state, light, data} = app;
    const slider = byId("bounce");
    byId("bounce-controls").hidden = light.bounces === 0;
    byId("bounce-none").hidden = light.bounces > 0;
    byId("bounce-none").textContent =
      data.bounces_left_out ? `Left out: ${data.bounces_left_out}.` : "This solution came without its single bounces.";
    slider.max = light.bounces;
    if (data.incomplete) {
      document.querySelector("#help .note").textContent = "Every slider scales light that has been solved, here not with all its bounces (see Statistics). A lamp’s colour filters its own.";
    }
    const set = (bounce) => {
      state.bounce = bounce;
      this.show();
      app.relight();
    };
    slider.addEventListener("input", () => {
      this.play(false);
      set(Number(slider.value));
    });
    byId("bounce-play").addEventListener("click", () => this.play(!this.playing, set));
  }

  /** The bounces as a film. */
  play(on, set) {
    clearInterval(this.playing);
    this.playing = 0;
    const {state, light} = this.app;
    if (on) {
      set(state.bounce >= light.bounces ? 0 : state.bounce);
      this.playing = setInterval(() => {
        set(Math.min(state.bounce + 1, light.bounces));
        if (state.bounce === light.bounces) this.play(false);
      }, 700);
    }
    byId("bounce-play").textContent = on ? "Stop" : "Play";
    byId("bounce-play").setAttribute("aria-pressed", String(on));
  }

  buttons() {
    const {app} = this;
    const on = (id, act) => byId(id).addEventListener("click", act);
    on("home", () => this.goHome());
    on("outside", () => {
      app.walker.fromOutside();
      this.show();
    });
    on("picture", () => app.savePicture());
    on("link", () => app.copyLink());
    on("help-open", () => byId("help").showModal());
  }

  goHome() {
    this.app.walker.home();
    this.show();
  }

  keys() {
    const tones = {Digit1: "filmic", Digit2: "linear", Digit3: "false"};
    document.addEventListener("keydown", (e) => {
      if (e.ctrlKey || e.metaKey || e.altKey || !Controls.mine(e.target)) return;
      const {app} = this, {view} = app;
      if (e.key === "?") byId("help").showModal();
      else if (e.code === "Home") this.goHome();
      else if (e.code === "KeyP") this.fold(!this.folded);
      else if (e.code === "Escape") app.inspect(-1);
      else if (e.code === "Enter" && e.target === view.canvas) {
        app.inspect(view.pick(view.free.left + view.free.width / 2, view.free.top + view.free.height / 2));
      } else if (tones[e.code]) {
        app.state.tone = tones[e.code];
        this.show();
        view.request();
      } else return;
      e.preventDefault();
    });
  }

  /** The hint goes with the first use of the room; the room's focus ring is for those who use keys. */
  guides() {
    const room = byId("room"), root = document.documentElement;
    const used = () => byId("hint").hidden = true;
    room.addEventListener("pointerdown", () => {
      delete root.dataset.keys;
      used();
    });
    room.addEventListener("wheel", used, {passive: true});
    document.addEventListener("keydown", (e) => {
      if (e.code === "Tab") root.dataset.keys = "1";
      if (e.target === room && e.code !== "Tab") used();
    });
  }

  theme() {
    const root = document.documentElement, names = ["auto", "light", "dark"];
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    let chosen = "auto";
    try {
      chosen = localStorage.getItem("interflect-theme") || "auto";
    } catch { /* a page from disk may be kept from it */ }
    const apply = () => {
      const shownDark = chosen === "dark" || (chosen !== "light" && dark.matches);
      root.dataset.theme = shownDark ? "dark" : "light";
      const text = `Theme: ${chosen === "auto" ? "as the system" : chosen}`;
      byId("theme").title = text;
      byId("theme").setAttribute("aria-label", text);
      this.app.view.renderer.setClearColor(getComputedStyle(root).getPropertyValue("--ground").trim());
      this.app.view.request();
    };
    byId("theme").addEventListener("click", () => {
      chosen = names[(names.indexOf(chosen) + 1) % names.length];
      try {
        localStorage.setItem("interflect-theme", chosen);
      } catch { /* not kept then */ }
      apply();
      this.say(byId("theme").title);
    });
    dark.addEventListener("change", apply);
    apply();
  }

  folding() {
    byId("fold").addEventListener("click", () => this.fold(!this.folded));
    this.fold(false);
    // On a phone the panel is as high as what is open in it.
    byId("controls").addEventListener("toggle", () => this.layout(), true);
  }

  fold(folded) {
    this.folded = folded;
    byId("panel").classList.toggle("folded", folded);
    byId("fold").setAttribute("aria-expanded", String(!folded));
    byId("controls").inert = folded;
    if (this.app.panel) this.layout();
  }

  /** Tells the view what the panel leaves free. */
  layout() {
    const {view, walker} = this.app;
    const box = byId("panel").getBoundingClientRect();
    const width = window.innerWidth, height = window.innerHeight;
    const sheet = box.width > 0.9 * width;
    const right = !sheet && !this.folded ? box.left : width;
    view.resize({left: 0, top: 0, width: right, height: sheet ? box.top : height});
    walker.apply();
  }

  /** Says something for a moment, or, not `seen`, to screen readers only. */
  say(text, seen = true) {
    const status = byId("status");
    status.textContent = text;
    status.classList.toggle("shown", seen);
    clearTimeout(this.saying);
    this.saying = setTimeout(() => status.classList.remove("shown"), 2500);
  }

  show() {
    const {state, walker, light, legend, data} = this.app;
    const check = (name, value) => document.getElementsByName(name).forEach((r) => r.checked = r.value === value);
    this.lamps.show();
    check("tone", state.tone);
    check("camera", walker.mode);
    check("scale", state.scale.kind);
    const falseColours = state.tone === "false";
    byId("exposure-controls").hidden = falseColours;
    byId("scale-controls").hidden = !falseColours;
    byId("scale-low").value = shown(state.scale.low, 5);
    byId("scale-high").value = shown(state.scale.high, 5);
    legend.show(state.scale, falseColours);
    const exposure = byId("exposure");
    this.middle = this.middle ?? state.exposure;
    exposure.min = Math.floor(Math.min(this.middle - 6, state.exposure));
    exposure.max = Math.ceil(Math.max(this.middle + 6, state.exposure));
    exposure.value = state.exposure;
    fillTrack(exposure);
    byId("exposure-value").textContent = `× ${shown(2 ** state.exposure, 3)}`;
    byId("smooth").checked = state.smooth;
    byId("wire").checked = state.wire;
    byId("bounce").value = state.bounce;
    fillTrack(byId("bounce"));
    byId("bounce-value").textContent =
      state.bounce >= light.bounces ? (data.incomplete ? "as far as solved" : "all bounces") : state.bounce === 1 ? "1 bounce" : `${state.bounce} bounces`;
    byId("hint").textContent = (walker.mode === "walk" ? "Drag to look around · W A S D to walk" :
      "Drag to turn the room · wheel to go nearer") + " · click a surface for its numbers";
  }
}
