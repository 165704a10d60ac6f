/** Objects and the path to drive: drawn over the cells, and told in words. Never when stale. */

import { stroke } from "./overlays.js";
import { setText } from "./words.js";

const AHEAD_S = 1; // so far an arrow of velocity goes
const DASHED = { moved: [6, 4] }; // in pixels, by kind
const FILLED = { moving: 0.45, wall: 0.7 }; // opacity
const SWEEP = 1; // kind of a point of the path
const UNSURE = 0.55; // opacity where the list may not be the robot's

/** `told`: the message `objects`, or null. Outlines are those of the map: closed, in metres. */
export function drawObjects({ context, px_m, colours, look }, told) {
  if (!told || look.is_stale) return;
  const opacity = told.state === "known" ? 1 : UNSURE;
  context.lineJoin = "round";
  for (const { outline, kind, v } of told.objects) {
    trace(context, outline);
    context.closePath();
    context.fillStyle = colours.object;
    context.globalAlpha = opacity * (FILLED[kind] ?? 0.15);
    context.fill();
    context.globalAlpha = opacity;
    stroke(context, colours.robot_edge, 4 * px_m);
    context.setLineDash((DASHED[kind] ?? []).map((px) => px * px_m));
    stroke(context, colours.object, (kind === "moving" ? 3 : 2) * px_m);
    context.setLineDash([]);
    if (kind === "moving") drawVelocity(context, middleOf(outline), v, colours, px_m);
  }
  context.globalAlpha = 1;
}

/** `told`: the message `path`, or null: a line where it sweeps, dashes where it only travels. */
export function drawPathAhead({ context, px_m, colours, look }, told) {
  if (!told || look.is_stale) return;
  const { points, kinds } = told;
  context.globalAlpha = told.state === "known" ? 1 : UNSURE;
  context.lineJoin = "round";
  for (const sweeps of [true, false]) {
    traceKind(context, points, kinds, sweeps);
    stroke(context, colours.robot_edge, 5 * px_m);
    context.setLineDash(sweeps ? [] : [7 * px_m, 5 * px_m]);
    stroke(context, colours.ahead, 3 * px_m);
    context.setLineDash([]);
  }
  context.globalAlpha = 1;
}

/** Beside the boxes that show and hide them. */
export function showVectors({ objects, path }, is_stale) {
  const moving = objects?.objects.filter(({ kind }) => kind === "moving").length;
  const counted = `${objects?.objects.length}${moving ? `, ${moving} moving` : ""}`;
  setText(document.getElementById("objects-words"), wordsOf(objects, counted, is_stale));
  setText(
    document.getElementById("ahead-words"),
    wordsOf(path, path?.kinds.length ? "" : "none", is_stale),
  );
}

function wordsOf(told, counted, is_stale) {
  if (!told || told.state === "none") return "";
  if (is_stale) return "not current";
  const more = told.left_out ? ` and ${told.left_out} not drawn` : "";
  return told.why ? `${counted}${more}; not sure: ${told.why}` : `${counted}${more}`;
}

function trace(context, outline) {
  context.beginPath();
  for (let k = 0; k + 1 < outline.length; k += 2) context.lineTo(outline[k], outline[k + 1]);
}

/** Lines to the points of one kind; none from or to a point that is not known. */
function traceKind(context, points, kinds, sweeps) {
  let end = 0; // of the line so far
  context.beginPath();
  for (let k = 1; k < kinds.length; k += 1) {
    const [x0, y0, x1, y1] = points.slice(2 * k - 2, 2 * k + 2);
    const is_known = [x0, y0, x1, y1].every(Number.isFinite);
    if (!is_known || (kinds[k] === SWEEP) !== sweeps) continue;
    if (end !== k - 1 || k === 1) context.moveTo(x0, y0);
    context.lineTo(x1, y1);
    end = k;
  }
}

function middleOf(outline) {
  const n = outline.length / 2,
    sum = [0, 0];
  outline.forEach((place, k) => (sum[k % 2] += place / n));
  return sum;
}

/** To where it is a second later, if it goes on so. */
function drawVelocity(context, [x_m, y_m], [v_x, v_y], colours, px_m) {
  const [x, y] = [x_m + v_x * AHEAD_S, y_m + v_y * AHEAD_S],
    bearing = Math.atan2(v_y, v_x);
  context.beginPath();
  context.moveTo(x_m, y_m);
  context.lineTo(x, y);
  for (const side of [0.45, -0.45]) {
    context.moveTo(x, y);
    context.lineTo(
      x - 11 * px_m * Math.cos(bearing + side),
      y - 11 * px_m * Math.sin(bearing + side),
    );
  }
  stroke(context, colours.robot_edge, 6 * px_m);
  stroke(context, colours.object, 3 * px_m);
}
