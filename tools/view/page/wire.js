/** What the server sends, as messages; what does not fit gives null. No DOM, no socket.
 *
 * Binary: u8 kind, u8 0, u16 length of the JSON header, header, payload; little-endian. */

const HEAD_BYTES = 4;
const MAX_SIZE = 4096; // cells along a side: bounds what a damaged header can make us allocate
export const UNKNOWN = 0,
  FREE = 1,
  OBSTACLE = 2;
const CHANGE_BYTES = 5; // u32 index in the window, u8 state
const text = new TextDecoder();

export function messageFromText(data) {
  const message = parsed(data);
  if (message === null || typeof message.type !== "string") return null;
  return (FITS[message.type]?.(message) ?? true) ? message : null;
}

export function messageFromFrame(buffer) {
  if (buffer.byteLength < HEAD_BYTES) return null;
  const head = new DataView(buffer);
  const header_bytes = head.getUint16(2, true);
  if (HEAD_BYTES + header_bytes > buffer.byteLength) return null;
  const header = parsed(text.decode(new Uint8Array(buffer, HEAD_BYTES, header_bytes)));
  const read = READERS[head.getUint8(0)];
  if (header === null || read === undefined || !Number.isFinite(header.t_s)) return null;
  return read(header, buffer.slice(HEAD_BYTES + header_bytes));
}

function parsed(data) {
  try {
    const value = JSON.parse(data);
    return value !== null && typeof value === "object" && !Array.isArray(value) ? value : null;
  } catch {
    return null;
  }
}

function isWindow(header, bytes, bytes_per_cell) {
  const { i, j, size, cell_m } = header;
  return (
    Number.isInteger(i) &&
    Number.isInteger(j) &&
    Number.isInteger(size) &&
    cell_m > 0 &&
    size > 0 &&
    size <= MAX_SIZE &&
    bytes === size * size * bytes_per_cell
  );
}

function wholeWindow(header, payload) {
  if (!isWindow(header, payload.byteLength, 1)) return null;
  return { ...header, type: "window", cells: new Uint8Array(payload) };
}

function changedCells(header, payload) {
  const { i, j, size } = header,
    n = payload.byteLength / CHANGE_BYTES;
  if (![i, j, size, n].every(Number.isInteger) || size <= 0 || size > MAX_SIZE) return null;
  return { ...header, type: "changes", payload: new DataView(payload), n };
}

function layer(header, payload) {
  if (!isWindow(header, payload.byteLength, 4) || typeof header.name !== "string") return null;
  return { ...header, type: "layer", values: new Float32Array(payload) };
}

function scanLine(header, payload) {
  if (payload.byteLength !== header.n * 12) return null;
  return { ...header, type: "scan", points: new Float32Array(payload) };
}

const isNumbers = (list, least) =>
  Array.isArray(list) && list.length >= least && list.length % 2 === 0 && list.every(Number.isFinite);

function isObject(told) {
  return isNumbers(told?.outline, 6) && isNumbers(told.v, 2) && typeof told.kind === "string";
}

const FITS = {
  objects: ({ t_s, objects }) =>
    Number.isFinite(t_s) && Array.isArray(objects) && objects.every(isObject),
  path: ({ t_s, points, kinds }) =>
    Number.isFinite(t_s) &&
    Array.isArray(points) &&
    Array.isArray(kinds) &&
    points.length === 2 * kinds.length,
};

const READERS = { 1: wholeWindow, 2: changedCells, 3: layer, 4: scanLine };

/** How much memory a message holds, about. */
export function bytesOf(message) {
  const big = message.cells ?? message.values ?? message.points ?? message.payload;
  const numbers = message.objects?.reduce((n, { outline }) => n + outline.length + 30, 0) ?? 0;
  return 600 + (big?.byteLength ?? 0) + 8 * (numbers + 1.5 * (message.points?.length ?? 0));
}
