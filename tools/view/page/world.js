/** All that is known at one moment: window, layers, scan line, objects, path, state. Built of
 * messages, in order. */

import { UNKNOWN } from "./wire.js";

const KEPT_STATES = 3; // of a cell: unknown, free, obstacle

export class World {
  constructor() {
    this.window = null; // {i, j, size, cell_m, epoch, cells, version}
    this.layers = new Map(); // name -> message; never changed, so snapshots share them
    this.scan = null;
    this.objects = null; // the message: all that there are
    this.path = null; // likewise: what is still to be driven
    this.state = null;
    this.t_s = null;
  }

  /** Takes a message; says whether it belongs to a map at all. */
  apply(message) {
    const take = TAKERS[message.type];
    if (take === undefined || !take(this, message)) return false;
    this.t_s = message.t_s;
    return true;
  }

  /** A copy to begin from again. */
  snapshot() {
    const { window, scan, objects, path, state, t_s } = this;
    const copy = window && { ...window, cells: window.cells.slice() };
    return { window: copy, layers: new Map(this.layers), scan, objects, path, state, t_s };
  }

  restore(snapshot) {
    Object.assign(this, snapshot);
    this.layers = new Map(snapshot.layers);
    this.window = snapshot.window && { ...snapshot.window, cells: snapshot.window.cells.slice() };
    if (this.window) this.window.version = nextVersion();
  }

  /** What is told of a cell; null outside of the window. */
  cell(i, j) {
    const at = this.window && indexOf(this.window, i, j);
    return at === null ? null : this.window.cells[at];
  }

  /** A layer's value at a cell; NaN where it has none. */
  value(name, i, j) {
    const layer = this.layers.get(name),
      at = layer ? indexOf(layer, i, j) : null;
    return at === null ? NaN : layer.values[at];
  }
}

let versions = 0; // of all windows: a new one for each change, so that pictures know when to be made
const nextVersion = () => (versions += 1);

export function indexOf({ i, j, size }, cell_i, cell_j) {
  const column = cell_i - i,
    row = cell_j - j;
  const inside = column >= 0 && row >= 0 && column < size && row < size;
  return inside ? row * size + column : null;
}

/** The cells of a window that has moved: what has left is forgotten, what enters is unknown. */
export function moved(window, i, j) {
  const { size, cells } = window,
    right = i - window.i,
    up = j - window.j;
  const to = new Uint8Array(size * size).fill(UNKNOWN);
  const first = Math.max(0, right),
    end = Math.min(size, size + right);
  for (let row = Math.max(0, up); row < Math.min(size, size + up) && first < end; row += 1) {
    const part = cells.subarray(row * size + first, row * size + end);
    to.set(part, (row - up) * size + first - right);
  }
  return to;
}

function takeWindow(world, message) {
  const { i, j, size, cell_m, epoch, cells } = message;
  if (world.window && world.window.epoch !== epoch) {
    world.layers.clear();
    world.objects = world.path = null;
  }
  world.window = { i, j, size, cell_m, epoch, cells: cells.slice(), version: nextVersion() };
  return true;
}

function takeChanges(world, { i, j, size, payload, n }) {
  const window = world.window;
  if (window === null || window.size !== size) return false;
  if (window.i !== i || window.j !== j) {
    window.cells = moved(window, i, j);
    window.i = i;
    window.j = j;
  }
  for (let k = 0; k < n; k += 1) {
    const at = payload.getUint32(5 * k, true),
      state = payload.getUint8(5 * k + 4);
    if (at < window.cells.length) window.cells[at] = state < KEPT_STATES ? state : UNKNOWN;
  }
  window.version = nextVersion();
  return true;
}

const TAKERS = {
  window: takeWindow,
  changes: takeChanges,
  layer: (world, message) => world.layers.set(message.name, message) && true,
  scan: (world, message) => (world.scan = message) && true,
  objects: (world, message) => (world.objects = message) && true,
  path: (world, message) => (world.path = message) && true,
  state: (world, message) => (world.state = message) && true,
};
