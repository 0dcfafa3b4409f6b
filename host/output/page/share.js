// A view in the address: camera, lamps, exposure, tone, bounce. What is as in the scene is left out.

/** The fragment for a state; see readFragment(). */
function writeFragment(app) {
  const {state, walker} = app;
  const digits = (v) => Number(v.toPrecision(6));
  const parts = {
    eye: walker.world(walker.eye).map(digits).join(","),
    to: walker.world(walker.target()).map(digits).join(","),
    camera: walker.mode,
    exposure: digits(2 ** state.exposure),
    tone: state.tone,
  };
  if (state.tone === "false") parts.scale = [state.scale.kind, digits(state.scale.low), digits(state.scale.high)].join(",");
  const lamps = state.lamps;
  if (lamps.some((l) => l.level !== 1)) parts.levels = lamps.map((l) => digits(l.level)).join(",");
  if (lamps.some((l) => !l.on)) parts.on = lamps.map((l) => l.on ? 1 : 0).join(",");
  if (lamps.some((l) => l.colour !== "#ffffff")) parts.colours = lamps.map((l) => l.colour.slice(1)).join(",");
  if (state.bounce < app.light.bounces) parts.bounce = state.bounce;
  if (!state.smooth) parts.shading = "flat";
  if (state.wire) parts.outlines = 1;
  if (state.patch >= 0) parts.patch = state.patch;
  return "#" + Object.entries(parts).map(([key, value]) => `${key}=${value}`).join("&");
}

/** Takes what a fragment says into the state; what makes no sense in it is passed over. */
function readFragment(fragment, app) {
  const {state, walker} = app;
  const parts = new Map();
  for (const part of fragment.replace(/^#/, "").split("&")) {
    const [key, value] = part.split("=");
    if (value !== undefined) parts.set(key, decodeText(value));
  }
  const numbers = (key) => (parts.get(key) || "").split(",").map((v) => v === "" ? NaN : Number(v));
  const all = (list, count) => list.length === count && list.every(Number.isFinite);
  const has = (key, ...allowed) => allowed.includes(parts.get(key));
  const eye = numbers("eye"), target = numbers("to");
  if (all(eye, 3) && all(target, 3)) walker.setEyes(eye, target);
  if (has("camera", "walk", "orbit")) walker.mode = parts.get("camera");
  const [exposure] = numbers("exposure");
  if (exposure > 0 && Number.isFinite(exposure)) state.exposure = Math.log2(exposure);
  if (has("tone", "filmic", "linear", "false")) state.tone = parts.get("tone");
  const [kind, low, high] = (parts.get("scale") || "").split(",");
  if ((kind === "log" || kind === "linear") && isScale(kind, Number(low), Number(high))) {
    state.scale = {kind, low: Number(low), high: Number(high)};
  }
  const count = state.lamps.length, levels = numbers("levels"), on = numbers("on");
  const colours = (parts.get("colours") || "").split(",");
  state.lamps.forEach((lamp, g) => {
    Object.assign(lamp, asInScene());
    if (all(levels, count)) lamp.level = Math.max(0, Math.min(2, levels[g]));
    if (all(on, count)) lamp.on = on[g] !== 0;
    if (colours.length === count && /^[0-9a-f]{6}$/i.test(colours[g])) lamp.colour = `#${colours[g].toLowerCase()}`;
  });
  const [bounce] = numbers("bounce"), [patch] = numbers("patch");
  state.bounce = Number.isInteger(bounce) && bounce >= 0 ? Math.min(bounce, app.light.bounces) : app.light.bounces;
  state.patch = Number.isInteger(patch) && patch >= 0 && patch < app.light.patches ? patch : -1;
  state.smooth = !has("shading", "flat");
  state.wire = has("outlines", "1");
  return Number.isFinite(exposure) && exposure > 0;
}

function decodeText(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

function isScale(kind, low, high) {
  return Number.isFinite(low) && Number.isFinite(high) && high > low && (kind === "linear" || low > 0);
}

/** Puts a fragment into the address without a new entry in the history. */
function replaceFragment(fragment) {
  try {
    history.replaceState(null, "", fragment);
  } catch {
    location.replace(fragment);  // a browser that keeps files from changing their address
  }
}

/** Copies a text; resolves to whether that worked. */
async function copyText(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    const field = document.createElement("textarea");
    field.value = text;
    document.body.append(field);
    field.select();
    const done = document.execCommand("copy");
    field.remove();
    return done;
  }
}
