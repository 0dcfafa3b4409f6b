// The room on the canvas: drawn when something has changed, not otherwise.

class View {
  /** Throws where there is no WebGL. `before` is called ahead of every picture. */
  constructor(canvas, data, before) {
    this.canvas = canvas;
    this.before = before;
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: true, powerPreference: "high-performance"});
    this.renderer.debug.checkShaderErrors = true;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera();
    this.free = {left: 0, top: 0, width: 1, height: 1};
    this.frame = 0;
    this.makeRoom(data);
    this.makeChosen();
    canvas.addEventListener("webglcontextrestored", () => this.request());
  }

  makeRoom(data) {
    const positions = data.section("positions"), corners = data.section("corners");
    this.place = new Float32Array(3 * corners.length);
    const corner = new Float32Array(corners.length), patchIndex = new Float32Array(corners.length);
    for (let k = 0; k < corners.length; ++k) {
      for (let axis = 0; axis < 3; ++axis) this.place[3 * k + axis] = positions[3 * corners[k] + axis];
      corner[k] = k % 3;
      patchIndex[k] = Math.floor(k / 3);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(this.place, 3));
    geometry.setAttribute("corner", new THREE.BufferAttribute(corner, 1));
    geometry.setAttribute("patchIndex", new THREE.BufferAttribute(patchIndex, 1));
    this.colours = new THREE.BufferAttribute(new Float32Array(3 * corners.length), 3).setUsage(THREE.DynamicDrawUsage);
    geometry.setAttribute("radiosity", this.colours);
    geometry.computeBoundingBox();
    this.bounds = geometry.boundingBox;
    this.size = this.bounds.min.distanceTo(this.bounds.max) || 1;
    this.uniforms = {
      exposure: {value: 1}, tone: {value: 1}, wire: {value: 0},
      ramp: {value: ramp.map(sRgbVector)}, over: {value: sRgbVector(overRange)},
      scale: {value: new THREE.Vector2(0, 1)}, logarithmic: {value: false},
    };
    this.material = new THREE.ShaderMaterial({
      vertexShader: surfaceVertex, fragmentShader: surfaceFragment, uniforms: this.uniforms,
      extensions: {derivatives: true},
    });
    this.patchMaterial = new THREE.ShaderMaterial({vertexShader: patchVertex, fragmentShader: patchFragment});
    this.room = new THREE.Mesh(geometry, this.material);
    this.room.frustumCulled = false;
    this.scene.add(this.room);
  }

  makeChosen() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(9), 3));
    geometry.setAttribute("corner", new THREE.BufferAttribute(new Float32Array([0, 1, 2]), 1));
    this.chosen = new THREE.Mesh(geometry, new THREE.ShaderMaterial({
      vertexShader: chosenVertex, fragmentShader: chosenFragment, transparent: true, depthWrite: false,
      uniforms: {colour: {value: sRgbVector("#ffb43a")}}, extensions: {derivatives: true},
      polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -2,
    }));
    this.chosen.frustumCulled = false;
    this.chosen.visible = false;
    this.scene.add(this.chosen);
  }

  /** Marks a patch, or none for -1. */
  choose(patch) {
    this.chosen.visible = patch >= 0;
    if (patch >= 0) {
      const position = this.chosen.geometry.getAttribute("position");
      position.copyArray(this.place.subarray(9 * patch, 9 * patch + 9));
      position.needsUpdate = true;
    }
    this.request();
  }

  /** The camera, in coordinates relative to the middle of the mesh; fov in radians, across the shorter side. */
  look(eye, forward, up, fov) {
    const {camera, size, free} = this;
    const aspect = free.width / free.height;
    camera.fov = 2 * Math.atan(Math.tan(fov / 2) / Math.min(aspect, 1)) * 180 / Math.PI;
    camera.aspect = aspect;
    camera.position.copy(eye);
    camera.up.copy(up);
    camera.lookAt(eye.clone().add(forward));
    camera.near = size / 3000;
    camera.far = eye.length() + 2 * size;
    this.offset();
    this.request();
  }

  /** The picture is centred in the part of the canvas that no panel covers. */
  offset() {
    const {left, top, width, height} = this.free;
    this.camera.setViewOffset(width, height, -left, -top, this.width, this.height);
    this.camera.updateMatrixWorld();
  }

  resize(free) {
    this.width = Math.max(1, this.canvas.clientWidth);
    this.height = Math.max(1, this.canvas.clientHeight);
    this.free = {...free, width: Math.max(1, free.width), height: Math.max(1, free.height)};
    this.fineness(1);
  }

  /** Pixels per pixel of the window's, by a share of what the screen has. */
  fineness(share) {
    this.share = share;
    document.documentElement.dataset.coarse = share < 1 ? "1" : "";
    this.renderer.setPixelRatio(share * Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(this.width, this.height, false);
  }

  request() {
    if (this.frame === 0) this.frame = requestAnimationFrame((time) => this.draw(time));
  }

  draw(time) {
    this.frame = 0;
    this.keepPace(time);
    this.before(time);
    this.renderer.render(this.scene, this.camera);
  }

  /**
   * Where pictures that follow each other come slowly, as without a graphics card, those in motion have fewer pixels;
   * the last one has them all.
   */
  keepPace(time) {
    const gap = time - (this.last ?? -Infinity);
    this.last = time;
    const inMotion = gap < 600;
    this.pace = inMotion ? 0.6 * (this.pace ?? 16) + 0.4 * gap : 16;
    if (inMotion && this.pace > 45 && this.share === 1) this.fineness(0.5);
    clearTimeout(this.resting);
    if (this.share < 1) {
      this.resting = setTimeout(() => {
        this.fineness(1);
        this.last = -Infinity;
        this.request();
      }, 250);
    }
  }

  /** The ray through a place on the canvas, in CSS pixels. */
  ray(x, y) {
    const caster = new THREE.Raycaster();
    caster.setFromCamera(new THREE.Vector2(2 * x / this.width - 1, 1 - 2 * y / this.height), this.camera);
    return caster.ray;
  }

  /** The patch whose front is seen there, or -1. */
  pick(x, y) {
    const {origin, direction} = this.ray(x, y);
    const place = this.place;
    let nearest = Infinity, found = -1;
    const a = new THREE.Vector3(), b = new THREE.Vector3(), c = new THREE.Vector3(), meets = new THREE.Vector3();
    const ray = new THREE.Ray(origin, direction);
    for (let k = 0; k < place.length; k += 9) {
      a.fromArray(place, k);
      b.fromArray(place, k + 3);
      c.fromArray(place, k + 6);
      if (ray.intersectTriangle(a, b, c, true, meets) === null) continue;
      const distance = meets.distanceToSquared(origin);
      if (distance < nearest) [nearest, found] = [distance, k / 9];
    }
    return found;
  }

  /** The patches that a coarse picture of the free part shows, one entry per pixel that shows any. */
  patchesInView() {
    const width = 160, height = Math.max(1, Math.min(320, Math.round(160 * this.free.height / this.free.width)));
    const target = new THREE.WebGLRenderTarget(width, height, {
      minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter, generateMipmaps: false});
    const bytes = new Uint8Array(4 * width * height);
    const {renderer, scene, camera, room} = this;
    const chosen = this.chosen.visible;
    const background = renderer.getClearColor().clone();
    this.chosen.visible = false;
    room.material = this.patchMaterial;
    camera.clearViewOffset();
    renderer.setClearColor(0x000000);
    renderer.setRenderTarget(target);
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(target, 0, 0, width, height, bytes);
    renderer.setRenderTarget(null);
    renderer.setClearColor(background);
    room.material = this.material;
    this.chosen.visible = chosen;
    this.offset();
    target.dispose();
    const patches = [];
    for (let k = 0; k < bytes.length; k += 4) {
      const number = bytes[k] + 256 * bytes[k + 1] + 65536 * bytes[k + 2];
      if (number > 0) patches.push(number - 1);
    }
    return patches;
  }

  /** The picture without the panel's offset, as a canvas of its own. */
  photograph() {
    this.fineness(1);
    const copy = document.createElement("canvas");
    const {camera, chosen} = this;
    const visible = chosen.visible;
    chosen.visible = false;
    camera.clearViewOffset();
    const before = {aspect: camera.aspect, fov: camera.fov};
    // The same angle across the shorter side, as look() has it.
    const across = Math.tan(camera.fov * Math.PI / 360) * Math.min(before.aspect, 1);
    camera.aspect = this.width / this.height;
    camera.fov = 2 * Math.atan(across / Math.min(camera.aspect, 1)) * 180 / Math.PI;
    camera.updateProjectionMatrix();
    this.renderer.render(this.scene, camera);
    copy.width = this.canvas.width;
    copy.height = this.canvas.height;
    copy.getContext("2d").drawImage(this.canvas, 0, 0);
    Object.assign(camera, before);
    chosen.visible = visible;
    this.offset();
    this.request();
    return copy;
  }
}

/** "#rrggbb" as a vector of sRGB values, 0..1. */
function sRgbVector(hex) {
  return new THREE.Vector3(...[1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255));
}
