// Mouse, touch and keys move the walker.

class Controls {
  /** `click(x, y)` is called for a press that moved nothing. */
  constructor(canvas, walker, click) {
    this.canvas = canvas;
    this.walker = walker;
    this.click = click;
    this.pointers = new Map();
    this.held = new Set();
    this.stepping = 0;
    canvas.addEventListener("pointerdown", (e) => this.down(e));
    canvas.addEventListener("pointermove", (e) => this.moved(e));
    canvas.addEventListener("pointerup", (e) => this.release(e));
    canvas.addEventListener("pointercancel", (e) => this.pointers.delete(e.pointerId));
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      const pixels = e.deltaMode === 1 ? 33 * e.deltaY : e.deltaY;
      walker.zoom(Math.max(-3, Math.min(3, -pixels / 100)));
    }, {passive: false});
    document.addEventListener("keydown", (e) => this.key(e));
    document.addEventListener("keyup", (e) => this.held.delete(e.code));
    window.addEventListener("blur", () => this.held.clear());
  }

  down(e) {
    this.canvas.focus({preventScroll: true});
    this.canvas.setPointerCapture(e.pointerId);
    this.pointers.set(e.pointerId, {x: e.clientX, y: e.clientY});
    if (this.pointers.size === 1) this.travelled = 0;
    else this.travelled = Infinity;
  }

  moved(e) {
    const at = this.pointers.get(e.pointerId);
    if (!at) return;
    const dx = e.clientX - at.x, dy = e.clientY - at.y;
    const unit = 1 / Math.min(this.canvas.clientWidth, this.canvas.clientHeight);
    const others = [...this.pointers.entries()].filter(([id]) => id !== e.pointerId).map(([, p]) => p);
    this.travelled += Math.hypot(dx, dy);
    if (others.length > 0) {
      this.pinch(at, others[0], dx, dy, unit);
    } else if (e.buttons === 2 || e.buttons === 4 || e.shiftKey) {
      this.walker.shift(-dx * unit, dy * unit);
    } else if (this.travelled > 4) {
      this.walker.turn(2.2 * dx * unit, 2.2 * dy * unit);
    }
    at.x += dx;
    at.y += dy;
  }

  /** One of two fingers moved: half of it shifts, and what parts them zooms. */
  pinch(at, other, dx, dy, unit) {
    const before = Math.hypot(at.x - other.x, at.y - other.y);
    const after = Math.hypot(at.x + dx - other.x, at.y + dy - other.y);
    if (before > 10 && after > 10) this.walker.zoom(Math.log(after / before) / 0.1625);
    this.walker.shift(-0.5 * dx * unit, 0.5 * dy * unit);
  }

  release(e) {
    const known = this.pointers.delete(e.pointerId);
    if (known && this.travelled <= 4 && e.button === 0) this.click(e.offsetX, e.offsetY);
  }

  static steps = new Set(["KeyW", "KeyA", "KeyS", "KeyD", "KeyQ", "KeyE", "ArrowUp", "ArrowDown", "ArrowLeft",
                          "ArrowRight", "Equal", "NumpadAdd", "Minus", "NumpadSubtract"]);

  key(e) {
    if (e.ctrlKey || e.metaKey || e.altKey || !Controls.mine(e.target) || !Controls.steps.has(e.code)) return;
    e.preventDefault();
    this.held.add(e.code);
    this.fast = e.shiftKey;
    if (this.stepping === 0) {
      this.last = performance.now();
      this.step(this.last + 16);
    }
  }

  /** Keys belong to the room unless a control that has use for them is focused. */
  static mine(element) {
    return !element.closest("input, select, textarea, dialog");
  }

  step(now) {
    this.stepping = 0;
    if (this.held.size === 0) return;
    const seconds = Math.max(0, Math.min(0.1, (now - this.last) / 1000));
    this.last = now;
    const axis = (plus, minus) => (this.held.has(plus) ? 1 : 0) - (this.held.has(minus) ? 1 : 0);
    const pace = (this.fast ? 3 : 1) * seconds, walker = this.walker, stride = pace * walker.view.size / 5;
    const across = axis("ArrowRight", "ArrowLeft"), along = axis("ArrowUp", "ArrowDown");
    walker.move(axis("KeyD", "KeyA") * stride, axis("KeyE", "KeyQ") * stride, axis("KeyW", "KeyS") * stride);
    if (walker.mode === "walk") {
      walker.turn(-1.2 * pace * across, 0);
      walker.move(0, 0, along * stride);
    } else {
      walker.turn(-1.2 * pace * across, -1.2 * pace * along);
    }
    const nearer = axis("Equal", "Minus") + axis("NumpadAdd", "NumpadSubtract");
    if (nearer !== 0) walker.zoom(6 * nearer * pace);
    this.stepping = requestAnimationFrame((time) => this.step(time));
  }
}
