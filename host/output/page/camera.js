// Where one stands and looks: an eye, a direction by yaw and pitch about the scene's up, and the distance to what Orbit
// turns around. Coordinates are relative to the middle of the mesh, as the positions are.

const steepest = 89 * Math.PI / 180;

class Walker {
  constructor(data, view) {
    this.view = view;
    this.origin = new THREE.Vector3(...data.origin);
    const {eye, target, up, fov} = data.camera;
    this.fov = fov;
    this.findUp(new THREE.Vector3(...eye), new THREE.Vector3(...target), new THREE.Vector3(...up));
    this.setEyes(eye, target);
    this.first = {eye, target};
    const inside = view.bounds.containsPoint(this.eye);
    this.mode = inside ? "walk" : "orbit";
    this.firstMode = this.mode;
  }

  /** The axis that stands upright in the picture; the camera's own up where none does. */
  findUp(eye, target, up) {
    const forward = target.clone().sub(eye).normalize();
    const right = forward.clone().cross(up).normalize();
    const upright = right.clone().cross(forward);
    this.up = upright.clone();
    let best = 0.3;
    for (const axis of [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]]) {
      const candidate = new THREE.Vector3(...axis);
      if (Math.abs(candidate.dot(right)) > 0.02 || candidate.dot(upright) < best) continue;
      best = candidate.dot(upright);
      this.up = candidate;
    }
    const other = Math.abs(this.up.x) < 0.6 ? new THREE.Vector3(1, 0, 0) : new THREE.Vector3(0, 0, 1);
    this.north = other.sub(this.up.clone().multiplyScalar(other.dot(this.up))).normalize();
    this.west = this.up.clone().cross(this.north);
  }

  /** From world coordinates, as a scene's camera or a link has them. */
  setEyes(eye, target) {
    this.eye = new THREE.Vector3(...eye).sub(this.origin);
    const view = new THREE.Vector3(...target).sub(this.origin).sub(this.eye);
    this.distance = view.length() || this.view.size / 10;
    view.normalize();
    this.pitch = Math.max(-steepest, Math.min(steepest, Math.asin(Math.max(-1, Math.min(1, view.dot(this.up))))));
    this.yaw = Math.atan2(view.dot(this.west), view.dot(this.north));
  }

  world(point) {
    return point.clone().add(this.origin).toArray();
  }
  target() {
    return this.eye.clone().addScaledVector(this.forward(), this.distance);
  }
  level() {
    return this.north.clone().multiplyScalar(Math.cos(this.yaw)).addScaledVector(this.west, Math.sin(this.yaw));
  }
  forward() {
    return this.level().multiplyScalar(Math.cos(this.pitch)).addScaledVector(this.up, Math.sin(this.pitch));
  }
  right() {
    return this.level().cross(this.up);
  }

  apply() {
    const reach = 6 * this.view.size;
    if (this.eye.length() > reach) this.eye.setLength(reach);
    this.view.look(this.eye, this.forward(), this.up, this.fov);
  }

  /** Radians to the left and upwards; Orbit goes around the target instead. */
  turn(left, upwards) {
    const target = this.target();
    const sign = this.mode === "orbit" ? -1 : 1;
    this.yaw += sign * left;
    this.pitch = Math.max(-steepest, Math.min(steepest, this.pitch + sign * upwards));
    if (this.mode === "orbit") this.eye = target.addScaledVector(this.forward(), -this.distance);
    this.apply();
  }

  /** Moves eye and target, in the scene's unit. */
  move(right, up, ahead) {
    this.eye.addScaledVector(this.right(), right).addScaledVector(this.up, up).addScaledVector(this.level(), ahead);
    this.apply();
  }

  /** Shifts across the picture by a share of what it shows. */
  shift(right, up) {
    const reach = this.mode === "orbit" ? this.distance : this.view.size / 5;
    const upwards = this.right().cross(this.forward());
    this.eye.addScaledVector(this.right(), right * reach).addScaledVector(upwards, up * reach);
    this.apply();
  }

  /** Nearer (positive) or farther, in notches. */
  zoom(notches) {
    if (this.mode === "orbit") {
      const target = this.target();
      this.distance = Math.max(this.view.size / 200, Math.min(5 * this.view.size, this.distance * 0.85 ** notches));
      this.eye = target.addScaledVector(this.forward(), -this.distance);
    } else {
      this.eye.addScaledVector(this.forward(), notches * this.view.size / 30);
    }
    this.apply();
  }

  home() {
    this.setEyes(this.first.eye, this.first.target);
    this.mode = this.firstMode;
    this.apply();
  }

  /** The whole scene, from outside and above; the backs of the walls do not hide it. */
  fromOutside() {
    this.mode = "orbit";
    this.pitch = -0.6;
    this.distance = 0.53 * this.view.size / Math.tan(this.fov / 2);
    this.eye = this.forward().multiplyScalar(-this.distance);
    this.apply();
  }
}
