/** Where the robot has been: poses, thinned; a jump begins a new line. */

const APART_M = 0.03,
  JUMP_M = 1;
const KEPT = 20_000;

export class Path {
  constructor() {
    this.points = []; // {t_s, x, y, is_first}, oldest first
  }

  add({ t_s, pose }) {
    const last = this.points[this.points.length - 1];
    if (last && t_s < last.t_s - 1) this.points = []; // another run
    if (!pose || (last && t_s < last.t_s)) return;
    const far_m = last ? Math.hypot(pose.x - last.x, pose.y - last.y) : Infinity;
    if (far_m < APART_M) return;
    this.points.push({ t_s, x: pose.x, y: pose.y, is_first: far_m > JUMP_M });
    if (this.points.length > KEPT) this.points.splice(0, KEPT / 4);
  }

  until(t_s) {
    return t_s === Infinity ? this.points : this.points.filter((point) => point.t_s <= t_s);
  }
}
