/** What lies on the cells: grid, path, stop zone, scan line, robot, marks of a cell.
 *
 * `brush`: {context (in metres of the map), px_m (metres a pixel), colours, view, look}. */

import { POSE_VALID, zoneName } from "./words.js";

const FARTHEST_M = 40; // a stop zone is drawn no longer
const MARKER_M = 0.3; // of a robot whose size is not known

export function drawGrid({ context, px_m, colours, view }) {
  const step_m = [0.5, 1, 2, 5, 10, 20, 50].find((step) => step / px_m >= 48) ?? 100;
  const half_m = (Math.hypot(view.width, view.height) / 2) * px_m;
  context.beginPath();
  for (let k = Math.ceil((view.x_m - half_m) / step_m); k * step_m < view.x_m + half_m; k += 1) {
    context.moveTo(k * step_m, view.y_m - half_m);
    context.lineTo(k * step_m, view.y_m + half_m);
  }
  for (let k = Math.ceil((view.y_m - half_m) / step_m); k * step_m < view.y_m + half_m; k += 1) {
    context.moveTo(view.x_m - half_m, k * step_m);
    context.lineTo(view.x_m + half_m, k * step_m);
  }
  stroke(context, colours.grid, px_m);
}

/** `path`: [{x, y, is_first}]; a jump begins a new line. */
export function drawPath({ context, px_m, colours }, path) {
  context.beginPath();
  for (const { x, y, is_first } of path) {
    if (is_first) context.moveTo(x, y);
    else context.lineTo(x, y);
  }
  context.lineJoin = "round";
  stroke(context, colours.robot_edge, 4 * px_m);
  stroke(context, colours.path, 2 * px_m);
}

export function drawScan({ context, px_m, colours, look }, { points }) {
  const side = 2.6 * px_m;
  context.fillStyle = look.is_stale ? colours.stale_obstacle : colours.scan;
  for (let k = 0; k + 2 < points.length; k += 3) {
    context.fillRect(points[k] - side / 2, points[k + 1] - side / 2, side, side);
  }
}

export function drawZone(brush, state, robot) {
  const { pose, zone } = state ?? {};
  if (!pose || !zone || brush.look.is_stale) return;
  const { context } = brush,
    sides = robot ?? { front_m: MARKER_M, rear_m: MARKER_M, width_m: 2 * MARKER_M };
  const said = zoneName(zone.state),
    name = said === "unknown" ? "stop" : said;
  context.save();
  context.translate(pose.x, pose.y);
  context.rotate(pose.yaw);
  const ahead_m = Math.min(zone.free_ahead_m ?? 0, FARTHEST_M),
    behind_m = Math.min(zone.free_behind_m ?? 0, FARTHEST_M);
  lane(brush, sides.front_m, ahead_m, sides.width_m, name);
  lane(brush, -sides.rear_m, -behind_m, sides.width_m, "clear");
  context.restore();
}

/** The free lane from x_m on: filled, with a bar where it ends. */
function lane({ context, px_m, colours }, x_m, long_m, wide_m, name) {
  const half_m = wide_m / 2,
    end_m = x_m + long_m;
  context.globalAlpha = 0.22;
  context.fillStyle = colours[name];
  context.fillRect(x_m, -half_m, long_m, wide_m);
  context.globalAlpha = 1;
  context.setLineDash(name === "clear" ? [] : [6 * px_m, 4 * px_m]);
  context.beginPath();
  for (const y_m of [-half_m, half_m]) {
    context.moveTo(x_m, y_m);
    context.lineTo(end_m, y_m);
  }
  stroke(context, colours[name], 1.5 * px_m);
  context.setLineDash([]);
  context.beginPath();
  context.moveTo(end_m, -half_m - 3 * px_m);
  context.lineTo(end_m, half_m + 3 * px_m);
  stroke(context, colours[name], (name === "stop" ? 5 : 3) * px_m);
}

/** Footprint and a nose; dashed while the pose is not valid, absent without one. */
export function drawRobot({ context, px_m, colours, look }, state, robot) {
  const pose = state?.pose;
  if (!pose) return;
  const is_valid = (state.health_bits & POSE_VALID) !== 0 && !look.is_stale;
  const sides = robot ?? { front_m: MARKER_M, rear_m: MARKER_M, width_m: 2 * MARKER_M };
  const front_m = Math.max(sides.front_m, 5 * px_m),
    rear_m = Math.max(sides.rear_m, 5 * px_m);
  const half_m = Math.max(sides.width_m / 2, 5 * px_m);
  context.save();
  context.translate(pose.x, pose.y);
  context.rotate(pose.yaw);
  context.setLineDash(is_valid ? [] : [5 * px_m, 4 * px_m]);
  context.beginPath();
  context.rect(-rear_m, -half_m, front_m + rear_m, 2 * half_m);
  context.globalAlpha = is_valid ? 0.9 : 0.35;
  context.fillStyle = look.is_stale ? colours.stale_obstacle : colours.robot;
  context.fill();
  context.globalAlpha = 1;
  stroke(context, colours.robot_edge, 2 * px_m);
  context.setLineDash([]);
  context.beginPath();
  context.moveTo(0.75 * front_m, 0);
  context.lineTo(-0.3 * rear_m, 0.55 * half_m);
  context.lineTo(-0.05 * rear_m, 0);
  context.lineTo(-0.3 * rear_m, -0.55 * half_m);
  context.closePath();
  context.fillStyle = colours.robot_edge;
  context.fill();
  context.restore();
}

export function drawPinned({ context, px_m, colours }, { i, j }, cell_m) {
  const margin_m = Math.max(px_m, (9 * px_m - cell_m) / 2);
  const side_m = cell_m + 2 * margin_m;
  for (const [colour, width] of [
    [colours.robot_edge, 4],
    [colours.cursor, 2],
  ]) {
    context.beginPath();
    context.rect(i * cell_m - margin_m, j * cell_m - margin_m, side_m, side_m);
    stroke(context, colour, width * px_m);
  }
}

/** In the middle, for those who choose a cell by keys. Drawn in pixels. */
export function drawCrosshair({ context, colours, view }) {
  const [x, y] = [Math.round(view.width / 2), Math.round(view.height / 2)];
  for (const [colour, width] of [
    [colours.robot_edge, 4],
    [colours.cursor, 2],
  ]) {
    context.beginPath();
    for (const [dx, dy] of [
      [1, 0],
      [-1, 0],
      [0, 1],
      [0, -1],
    ]) {
      context.moveTo(x + 5 * dx, y + 5 * dy);
      context.lineTo(x + 13 * dx, y + 13 * dy);
    }
    stroke(context, colour, width);
  }
}

/** An arrow along map x about a place in pixels. */
export function drawCompass(context, view, colours, x, y) {
  context.save();
  context.translate(x, y);
  context.beginPath();
  context.arc(0, 0, 17, 0, 2 * Math.PI);
  context.fillStyle = colours.panel;
  context.globalAlpha = 0.88;
  context.fill();
  context.globalAlpha = 1;
  context.rotate(view.up_rad);
  for (const [side, colour] of [
    [1, colours.ink],
    [-1, colours.grid_ink],
  ]) {
    context.beginPath();
    context.moveTo(0, -13);
    context.lineTo(5 * side, 6);
    context.lineTo(0, 3);
    context.closePath();
    context.fillStyle = colour;
    context.fill();
  }
  context.restore();
  context.font = "600 11px system-ui, sans-serif";
  context.textAlign = "center";
  outlined(context, "map x", x, y + 31, colours);
  context.textAlign = "left";
}

/** Scale bar; `x`, `y`: left and foot, in pixels. */
export function drawScale(context, view, colours, x, y) {
  const bar_m =
    [0.1, 0.2, 0.5, 1, 2, 5, 10, 20].filter((m) => m * view.px_per_m <= 130).pop() ?? 0.1;
  const long = bar_m * view.px_per_m;
  context.font = "600 12px system-ui, sans-serif";
  context.lineJoin = "round";
  outlined(context, `${bar_m} m`, x + long + 8, y, colours);
  for (const [colour, width] of [
    [colours.panel, 6],
    [colours.ink, 2.5],
  ]) {
    context.beginPath();
    context.moveTo(x, y - 8);
    context.lineTo(x, y - 1);
    context.lineTo(x + long, y - 1);
    context.lineTo(x + long, y - 8);
    stroke(context, colour, width);
  }
}

export function outlined(context, words, x, y, colours) {
  context.lineWidth = 4;
  context.strokeStyle = colours.panel;
  context.strokeText(words, x, y);
  context.fillStyle = colours.ink;
  context.fillText(words, x, y);
}

export function stroke(context, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}
