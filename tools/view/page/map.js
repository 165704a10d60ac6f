/** Draws the obstacle map on a 2-D canvas: cells, then what lies on them. Draws only. */

import {
  drawCompass,
  drawCrosshair,
  drawGrid,
  drawPath,
  drawPinned,
  drawRobot,
  drawScale,
  drawScan,
  drawZone,
} from "./overlays.js";
import { drawObjects, drawPathAhead } from "./outlines.js";
import { LayerPicture, StatePicture } from "./pictures.js";

const MOST_RATIO = 2; // device pixels a CSS pixel: more costs time and shows nothing
const HATCH_PX = 7;
const NARROW_PX = 560;

export class MapCanvas {
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.context = canvas.getContext("2d", { alpha: false });
    this.cells = new StatePicture();
    this.layer = new LayerPicture();
    this.hatch = { key: "", pattern: null };
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ratio = (this.ratio = Math.min(MOST_RATIO, window.devicePixelRatio || 1));
    Object.assign(this.view, { width, height });
    const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== w) this.canvas.width = w;
    if (this.canvas.height !== h) this.canvas.height = h;
  }

  /** `scene`: {world, look, robot, path, shows, layer, scale, cursor, pinned, is_focused}. */
  draw(scene) {
    this.resize();
    const { context, view, canvas, ratio } = this,
      { world, look } = scene;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.fillStyle = look.colours.outside;
    context.fillRect(0, 0, canvas.width, canvas.height);
    context.setTransform(...view.transform(ratio));
    if (world.window) this.drawCells(scene);
    const brush = { context, px_m: 1 / view.px_per_m, colours: look.colours, view, look };
    if (scene.shows.grid) drawGrid(brush);
    if (scene.shows.zone) drawZone(brush, world.state, scene.robot);
    if (scene.shows.path) drawPath(brush, scene.path);
    if (scene.shows.scan && world.scan) drawScan(brush, world.scan);
    if (scene.shows.objects) drawObjects(brush, world.objects);
    if (scene.shows.ahead) drawPathAhead(brush, world.path);
    drawRobot(brush, world.state, scene.robot);
    if (scene.pinned && world.window) drawPinned(brush, scene.pinned, world.window.cell_m);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    if (scene.is_focused) drawCrosshair(brush);
    const [x, y] = view.width < NARROW_PX ? [60, 36] : [14, view.height - 14]; // below lie the tools
    drawScale(context, view, look.colours, x, y);
    drawCompass(context, view, look.colours, 30, 30);
  }

  drawCells({ world, look, layer, scale, shows }) {
    const { context } = this,
      { i, j, size, cell_m } = world.window;
    context.fillStyle = this.hatched(look);
    context.fillRect(i * cell_m, j * cell_m, size * cell_m, size * cell_m);
    const px_per_cell = cell_m * this.view.px_per_m * this.ratio;
    const shared = px_per_cell >= 1 ? 1 : Math.min(8, 2 ** Math.ceil(-Math.log2(px_per_cell)));
    if (layer) {
      this.layer.draw(layer, scale, look);
      this.put(this.layer, layer.cell_m, px_per_cell);
    }
    if (!layer || shows.marks) {
      this.cells.draw(world.window, look, shared, Boolean(layer));
      this.put(this.cells, cell_m, px_per_cell * shared);
    }
    context.lineWidth = 1 / this.view.px_per_m;
    context.strokeStyle = look.colours.edge;
    context.strokeRect(i * cell_m, j * cell_m, size * cell_m, size * cell_m);
  }

  put({ canvas, place }, cell_m, px_per_pixel) {
    const side_m = place.cells * cell_m;
    this.context.imageSmoothingEnabled = px_per_pixel < 1;
    this.context.drawImage(canvas, place.i * cell_m, place.j * cell_m, side_m, side_m);
  }

  /** The hatch of unknown ground, fixed to the map. */
  hatched(look) {
    if (this.hatch.key !== look.key) {
      this.hatch = { key: look.key, pattern: hatchPattern(this.context, look.colours) };
    }
    const px_m = 1 / (this.view.px_per_m * this.ratio);
    this.hatch.pattern.setTransform(new DOMMatrix([px_m, 0, 0, px_m, 0, 0]));
    return this.hatch.pattern;
  }
}

/** Slanting lines on one colour. */
function hatchPattern(context, { unknown, hatch }) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = HATCH_PX;
  const brush = tile.getContext("2d");
  brush.fillStyle = unknown;
  brush.fillRect(0, 0, HATCH_PX, HATCH_PX);
  brush.fillStyle = hatch;
  for (let k = 0; k < HATCH_PX; k += 1) brush.fillRect(k, k, 1.6, 1);
  return context.createPattern(tile, "repeat");
}
