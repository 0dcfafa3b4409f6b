// The page: its state, and who must know when it changes.

const byId = (id) => document.getElementById(id);

class App {
  constructor() {
    this.data = readData();
    this.light = new Light(this.data);
    this.state = {
      lamps: this.data.lamps.map(asInScene), exposure: 0, tone: "filmic", scale: null,
      bounce: this.light.bounces, smooth: true, wire: false, patch: -1,
    };
    this.stale = {light: true, colours: true};
    this.view = new View(byId("room"), this.data, () => this.update());
    this.walker = new Walker(this.data, this.view);
    this.legend = new Legend(this.light, this.data);
    this.inspector = new Inspector(this.data, this.light);
    const exposed = readFragment(location.hash, this);
    this.panel = new Panel(this);
    this.controls = new Controls(byId("room"), this.walker, (x, y) => this.inspect(this.view.pick(x, y)));
    this.panel.layout();
    this.mix();
    if (!exposed) this.exposeAutomatically();
    if (!this.state.scale) this.state.scale = this.legend.fit("linear");
    this.show();
    if (this.data.served) this.live = new Live(this);
  }

  /** The light as the lamps are set now. */
  mix() {
    if (!this.stale.light) return;
    this.light.mix(weightsOf(this.state.lamps), this.state.bounce);
    this.stale = {light: false, colours: true};
  }

  /** Before a picture is drawn: only what has changed is computed anew. */
  update() {
    const {state, view} = this;
    const mixed = this.stale.light;
    this.mix();
    if (this.stale.colours) {
      this.light.fill(view.colours.array, state.smooth);
      view.colours.needsUpdate = true;
      this.stale.colours = false;
    }
    if (mixed) this.inspector.show(state.patch, weightsOf(state.lamps));
    const {uniforms} = view, {kind, low, high} = state.scale;
    uniforms.exposure.value = 2 ** state.exposure;
    uniforms.tone.value = {linear: 0, filmic: 1, false: 2}[state.tone];
    uniforms.logarithmic.value = kind === "log";
    uniforms.scale.value.set(...(kind === "log" ? [Math.log(low), Math.log(high)] : [low, high]));
    uniforms.wire.value = state.wire ? 1.2 * view.renderer.getPixelRatio() : 0;
    this.remember();
  }

  /** The lamps or the bounce have changed. */
  relight() {
    this.stale.light = true;
    this.view.request();
  }

  /** Everything may have changed. */
  show() {
    this.stale = {light: true, colours: true};
    this.panel.show();
    this.walker.apply();
    this.inspect(this.state.patch);
  }

  /** As render() does: from what the surfaces in view show, lamps apart. */
  exposeAutomatically() {
    this.mix();
    this.walker.apply();
    const {radiosity} = this.light;
    const values = this.view.patchesInView().filter((i) => !this.inspector.emits(i)).map((i) => [
      Math.max(radiosity[3 * i], radiosity[3 * i + 1], radiosity[3 * i + 2]), 1]);
    const factor = automaticExposure(values, this.state.tone === "linear" ? "linear" : "filmic");
    this.state.exposure = Math.max(-40, Math.min(40, Math.log2(factor)));
  }

  inspect(patch) {
    this.state.patch = patch;
    this.mix();
    const said = this.inspector.show(patch, weightsOf(this.state.lamps));
    this.panel.lamps.mark(patch >= 0 ? this.inspector.lampOf(patch) : -1);
    this.view.choose(patch);
    if (patch >= 0) {
      byId("inspector").open = true;
      this.panel.say(said, false);
    }
  }

  /** The address follows, a moment later: browsers allow only so many changes. */
  remember() {
    clearTimeout(this.remembering);
    this.remembering = setTimeout(() => {
      this.fragment = writeFragment(this);
      replaceFragment(this.fragment);
    }, 300);
  }

  savePicture() {
    const picture = this.view.photograph();
    if (this.state.tone === "false") this.legend.paint(picture, this.state.scale, this.view.renderer.getPixelRatio());
    picture.toBlob((blob) => {
      const link = document.createElement("a");
      link.href = URL.createObjectURL(blob);
      link.download = `${this.data.title.replace(/[^\w.-]+/g, "_") || "room"}.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      this.panel.say("The picture was saved");
    }, "image/png");
  }

  async copyLink() {
    replaceFragment(writeFragment(this));
    const done = await copyText(location.href);
    this.panel.say(done ? "A link to this view was copied" : "The address of this page is the link to this view");
  }
}

function start() {
  try {
    const app = new App();
    window.addEventListener("hashchange", () => {
      if (location.hash === app.fragment) return;
      readFragment(location.hash, app);
      app.show();
    });
    document.documentElement.dataset.ready = "1";
  } catch (error) {
    const note = byId("hint");
    note.hidden = false;
    note.textContent = /WebGL/i.test(String(error)) ? "This browser offers no WebGL, with which the room is drawn." :
      `The page cannot show the room: ${error.message}`;
    document.documentElement.dataset.ready = "failed";
    throw error;
  }
}

start();
