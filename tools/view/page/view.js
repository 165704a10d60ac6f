/** Where a person looks: metres of the map to pixels of the canvas and back. */

const LEAST_PX_PER_M = 4,
  MOST_PX_PER_M = 1600;

export class View {
  constructor() {
    this.x_m = 0; // in the middle of the canvas
    this.y_m = 0;
    this.px_per_m = 40;
    this.up_rad = 0; // direction of the map that is up on the screen: 0 is map x
    this.width = this.height = 1; // CSS pixels
    this.is_following = true;
    this.is_heading_up = false;
    this.has_fitted = false;
  }

  /** (a, b, c, d, e, f) of a canvas transform from metres to pixels. */
  transform(ratio = 1) {
    const s = this.px_per_m * ratio,
      up_x = Math.cos(this.up_rad) * s,
      up_y = Math.sin(this.up_rad) * s;
    const e = (this.width * ratio) / 2 - (up_y * this.x_m - up_x * this.y_m);
    const f = (this.height * ratio) / 2 + (up_x * this.x_m + up_y * this.y_m);
    return [up_y, -up_x, -up_x, -up_y, e, f];
  }

  pixel(x_m, y_m) {
    const [a, b, c, d, e, f] = this.transform();
    return [a * x_m + c * y_m + e, b * x_m + d * y_m + f];
  }

  place(x_px, y_px) {
    const up = (this.height / 2 - y_px) / this.px_per_m,
      left = (this.width / 2 - x_px) / this.px_per_m;
    const cos = Math.cos(this.up_rad),
      sin = Math.sin(this.up_rad);
    return [this.x_m + up * cos - left * sin, this.y_m + up * sin + left * cos];
  }

  /** Moves the picture by pixels. */
  pan(dx_px, dy_px) {
    [this.x_m, this.y_m] = this.place(this.width / 2 - dx_px, this.height / 2 - dy_px);
    this.is_following = false;
  }

  /** Zooms about a pixel, which keeps its place. */
  zoom(factor, x_px = this.width / 2, y_px = this.height / 2) {
    const [x_m, y_m] = this.place(x_px, y_px);
    this.px_per_m = Math.min(MOST_PX_PER_M, Math.max(LEAST_PX_PER_M, this.px_per_m * factor));
    if (this.is_following) return;
    const [now_x_m, now_y_m] = this.place(x_px, y_px);
    this.x_m += x_m - now_x_m;
    this.y_m += y_m - now_y_m;
  }

  follow(pose) {
    this.up_rad = this.is_heading_up && pose ? pose.yaw : 0;
    if (this.is_following && pose) [this.x_m, this.y_m] = [pose.x, pose.y];
  }

  /** The whole of a window, or at first a part of it about the robot. */
  fit({ i, j, size, cell_m }, most_m = Infinity) {
    this.px_per_m = (0.94 * Math.min(this.width, this.height)) / Math.min(size * cell_m, most_m);
    this.x_m = (i + size / 2) * cell_m;
    this.y_m = (j + size / 2) * cell_m;
    this.has_fitted = true;
  }
}
