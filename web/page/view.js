// A camera that goes round a point, and where points are in its picture.

const add = (a, b, s = 1) => a.map((x, i) => x + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [0, 1, 2].map((i) => a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
const unit = (a) => a.map((x) => x / Math.hypot(...a));
const radians = Math.PI / 180;

export class View {
  /** From where a camera is; `up` stays the y axis. */
  constructor({ eye, target, fov }) {
    const offset = add(eye, target, -1);
    this.target = target;
    this.distance = Math.hypot(...offset);
    this.fov = fov;
    this.yaw = Math.atan2(offset[0], offset[2]);
    this.pitch = Math.asin(offset[1] / this.distance);
    /** How many times as far away the camera stands, with as much longer a lens. */
    this.far = 1;
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-1.55, Math.min(1.55, this.pitch + pitch));
  }

  zoom(factor) {
    this.distance *= factor;
  }

  /** As the library wants it. */
  camera() {
    const [c, s] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    const back = [c * Math.sin(this.yaw), s, c * Math.cos(this.yaw)];
    const fov = (2 * Math.atan(Math.tan((this.fov * radians) / 2) / this.far)) / radians;
    return { eye: add(this.target, back, this.distance * this.far), target: this.target, up: [0, 1, 0], fov };
  }

  /** Looks at a line from beside it. */
  beside(direction, middle) {
    const across = unit(cross(unit(direction), [0, 1, 0.01]));
    this.target = middle;
    this.yaw = Math.atan2(across[0], across[2]);
    this.pitch = 0.3;
    this.far = 1;
  }

  /** A function that tells where a point is in a square picture, or nothing if it is behind the camera. */
  projection(size) {
    const { eye, target, fov } = this.camera();
    const forward = unit(add(target, eye, -1));
    const right = unit(cross(forward, [0, 1, 0]));
    const up = cross(right, forward);
    const scale = size / 2 / Math.tan((fov * radians) / 2);
    return (point) => {
      const offset = add(point, eye, -1);
      const depth = dot(offset, forward);
      if (depth <= 0) return null;
      return [size / 2 + (scale * dot(offset, right)) / depth, size / 2 - (scale * dot(offset, up)) / depth];
    };
  }
}
