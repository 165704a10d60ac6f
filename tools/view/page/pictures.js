/** Cells as small pictures, a pixel a cell, made anew only when they have changed. */

import { codeColour, ramp, rampIndex, statePixels } from "./colours.js";
import { OBSTACLE } from "./wire.js";

const RANK = [1, 0, 2]; // of unknown, free, obstacle: where cells share a pixel, the worst is drawn
const CLASSES = [1, 0, 2]; // by rank

/** A picture of a square window of the map: where it lies in cells, and what made it. */
class CellPicture {
  constructor() {
    this.canvas = document.createElement("canvas");
    this.key = "";
    this.place = null; // {i, j, cells}: lowest corner, cells along a side
  }

  /** Fills it by `paint(pixels, n)` unless `key` is the same as before. */
  make(key, i, j, n, cells_per_pixel, paint) {
    if (key === this.key) return;
    this.key = key;
    if (this.canvas.width !== n) this.canvas.width = this.canvas.height = n;
    const context = this.canvas.getContext("2d"),
      image = context.createImageData(n, n);
    paint(new Uint32Array(image.data.buffer), n);
    context.putImageData(image, 0, 0);
    this.place = { i, j, cells: n * cells_per_pixel };
  }
}

export class StatePicture extends CellPicture {
  /** Free and obstacle; `marks_only`: obstacles alone, each second cell, to lie on a layer. */
  draw(window, look, cells_per_pixel, marks_only) {
    const key = [window.version, look.key, look.is_stale, cells_per_pixel, marks_only].join();
    const { i, j, n, cells } = shrunk(window, cells_per_pixel);
    this.make(key, i, j, n, cells_per_pixel, (pixels) => {
      const table = statePixels(look.colours, look.is_stale);
      if (marks_only) return paintMarks(pixels, cells, n, i + j, table[OBSTACLE]);
      for (let k = 0; k < pixels.length; k += 1) pixels[k] = table[cells[k]];
      return undefined;
    });
  }
}

function paintMarks(pixels, cells, n, phase, pixel) {
  for (let k = 0; k < cells.length; k += 1) {
    const is_odd = (phase + (k % n) + Math.floor(k / n)) & 1;
    if (cells[k] === OBSTACLE && is_odd) pixels[k] = pixel;
  }
}

/** Blocks of f x f cells as one of their worst class, aligned to the map and not to the window. */
function shrunk({ i, j, size, cells }, f) {
  if (f === 1) return { i, j, n: size, cells };
  const left = Math.floor(i / f),
    low = Math.floor(j / f);
  const n = Math.max(Math.ceil((i + size) / f) - left, Math.ceil((j + size) / f) - low);
  const ranks = new Uint8Array(n * n);
  for (let row = 0; row < size; row += 1) {
    const to = (Math.floor((j + row) / f) - low) * n - left;
    for (let column = 0; column < size; column += 1) {
      const at = to + Math.floor((i + column) / f),
        rank = RANK[cells[row * size + column]];
      if (rank > ranks[at]) ranks[at] = rank;
    }
  }
  return {
    i: left * f,
    j: low * f,
    n,
    cells: classesOf(ranks, n, { i, j, size }, left * f, low * f, f),
  };
}

/** Ranks to classes; what lies beyond the window is unknown and not free. */
function classesOf(ranks, n, window, i, j, f) {
  const right = window.i + window.size,
    top = window.j + window.size;
  return ranks.map((rank, k) => {
    const column = i + (k % n) * f,
      row = j + Math.floor(k / n) * f;
    const is_whole = column >= window.i && row >= window.j && column + f <= right && row + f <= top;
    return rank === 0 && !is_whole ? 0 : CLASSES[rank];
  });
}

export class LayerPicture extends CellPicture {
  /** A layer of numbers by the ramp of its scale, or of codes. */
  draw(layer, scale, look) {
    const key = [layer.name, layer.t_s, scale.low, scale.high, look.key, look.is_stale].join();
    this.make(key, layer.i, layer.j, layer.size, 1, (pixels) => {
      const table = layerPixels(scale, look),
        { values } = layer;
      for (let k = 0; k < pixels.length; k += 1) {
        const value = values[k];
        if (Number.isNaN(value)) continue;
        pixels[k] = table[scale.is_codes ? value & 255 : rampIndex(value, scale)];
      }
    });
  }
}

export function layerPixels(scale, look) {
  const colours = scale.is_codes ? null : ramp(scale.low < 0, look.colours.is_dark);
  return Uint32Array.from({ length: 256 }, (_, k) => {
    const [r, g, b] = colours ? colours.subarray(3 * k, 3 * k + 3) : codeColour(k);
    const grey = 64 + Math.round((0.21 * r + 0.72 * g + 0.07 * b) / 2);
    const [red, green, blue] = look.is_stale ? [grey, grey, grey] : [r, g, b];
    return (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0;
  });
}
