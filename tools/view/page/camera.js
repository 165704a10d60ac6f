/** The camera of the relief: turns about a point of the ground. Matrices are column-major. */

const LOWEST_RAD = 0.12,
  HIGHEST_RAD = 1.55;
const FIELD_RAD = 0.75;

export class Camera {
  constructor() {
    this.turn_rad = Math.PI; // direction of the map in which the camera stands: behind the start
    this.tilt_rad = 0.75; // above the ground
    this.away_m = 12;
    this.x_m = this.y_m = 0; // what it looks at
  }

  turn(turn_rad, tilt_rad) {
    this.turn_rad += turn_rad;
    this.tilt_rad = Math.min(HIGHEST_RAD, Math.max(LOWEST_RAD, this.tilt_rad + tilt_rad));
  }

  zoom(factor) {
    this.away_m = Math.min(80, Math.max(1, this.away_m / factor));
  }

  /** Metres, relative to what it looks at, to clip space. */
  matrix(aspect) {
    const level = Math.cos(this.tilt_rad),
      eye = [
        this.away_m * level * Math.cos(this.turn_rad),
        this.away_m * level * Math.sin(this.turn_rad),
        this.away_m * Math.sin(this.tilt_rad),
      ];
    return product(perspective(aspect, this.away_m / 50, this.away_m + 60), lookAtOrigin(eye));
  }
}

function perspective(aspect, near, far) {
  const f = 1 / Math.tan(FIELD_RAD / 2),
    depth = near - far;
  const across = aspect < 1 ? f : f / aspect;
  const along = aspect < 1 ? f * aspect : f;
  return [
    across,
    0,
    0,
    0,
    0,
    along,
    0,
    0,
    0,
    0,
    (far + near) / depth,
    -1,
    0,
    0,
    (2 * far * near) / depth,
    0,
  ];
}

/** From an eye to the origin; z is up. */
function lookAtOrigin(eye) {
  const back = unit(eye),
    right = unit([-back[1], back[0], 0]);
  const up = [
    back[1] * right[2] - back[2] * right[1],
    back[2] * right[0] - back[0] * right[2],
    back[0] * right[1] - back[1] * right[0],
  ];
  const rows = [right, up, back];
  return [0, 1, 2]
    .flatMap((k) => [...rows.map((row) => row[k]), 0])
    .concat([0, 0, -Math.hypot(...eye), 1]);
}

function unit(vector) {
  const length = Math.hypot(...vector);
  return vector.map((part) => part / length);
}

function product(a, b) {
  return Float32Array.from({ length: 16 }, (_, k) => {
    const row = k % 4,
      column = 4 * Math.floor(k / 4);
    return [0, 1, 2, 3].reduce((sum, n) => sum + a[4 * n + row] * b[column + n], 0);
  });
}
