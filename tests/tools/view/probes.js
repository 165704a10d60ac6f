/** What tests ask the page, or do to it: put before the one expression that a test runs. */

/** The colour of the map's canvas at a place of the map. */
function pixelAt(x_m, y_m) {
  const [x, y] = mapod.view.pixel(x_m, y_m), ratio = mapod.map.ratio;
  const { data } = mapod.map.context.getImageData(x * ratio, y * ratio, 1, 1);
  return hex(data[0] | (data[1] << 8) | (data[2] << 16));
}

/** How many pixels of the map's canvas have each colour. */
function countColours() {
  const { width, height } = mapod.map.canvas, counts = {};
  const { data } = mapod.map.context.getImageData(0, 0, width, height);
  for (const pixel of new Uint32Array(data.buffer)) counts[pixel] = (counts[pixel] ?? 0) + 1;
  return Object.fromEntries(Object.entries(counts).map(([pixel, n]) => [hex(pixel), n]));
}

const hex = (pixel) =>
  "#" + [0, 8, 16].map((at) => ((pixel >> at) & 255).toString(16).padStart(2, "0")).join("");

/** Where a place of the map is in the browser's window. */
function placeInWindow(x_m, y_m) {
  const { left, top } = mapod.map.canvas.getBoundingClientRect(), [x, y] = mapod.view.pixel(x_m, y_m);
  return [left + x, top + y];
}

function middleOf(css) {
  const { x, y, width, height } = document.querySelector(css).getBoundingClientRect();
  return [x + width / 2, y + height / 2];
}

function setSlider(css, value) {
  const slider = document.querySelector(css);
  slider.value = value;
  slider.dispatchEvent(new Event("input"));
}

/** How many elements the Tab key should come to. */
function countStops() {
  const all = document.querySelectorAll("a[href], button, input, canvas, [tabindex='0']");
  const isStop = (e) => e.checkVisibility() && !e.disabled && e.tabIndex >= 0;
  return [...all].filter((e) => isStop(e) && (e.type !== "radio" || e.checked)).length;
}

/** [a name for what has the focus, how broad the line around it is, its HTML]. */
function focused() {
  const e = document.activeElement;
  if (e === document.body) return [null, "", ""];
  e.dataset.n ??= document.querySelectorAll("[data-n]").length;
  return [e.dataset.n, getComputedStyle(e).outlineWidth, e.outerHTML];
}

function nameless() {
  const all = [...document.querySelectorAll("button, input, canvas[tabindex]")];
  const isNamed = (e) => e.textContent.trim() || e.ariaLabel || e.labels?.length;
  return all.filter((e) => !isNamed(e)).map((e) => e.outerHTML);
}

/** Buttons that a finger can hardly hit. */
function smallButtons() {
  const all = [...document.querySelectorAll("main button")].filter((e) => !e.closest("#readout"));
  const isSmall = (e) => e.checkVisibility() && e.getBoundingClientRect().height < 32;
  return all.filter(isSmall).map((e) => e.outerHTML);
}

/** Pans for 60 frames: [frames, pictures of cells made, changes of the window]. */
function countPaints(done) {
  const put = CanvasRenderingContext2D.prototype.putImageData, { version } = mapod.live.window;
  let frames = 0, painted = 0;
  CanvasRenderingContext2D.prototype.putImageData = function (...values) {
    painted += 1;
    put.apply(this, values);
  };
  const frame = () => {
    mapod.view.pan(1, 0);
    mapod.changed();
    frames += 1;
    if (frames < 60) requestAnimationFrame(frame);
    else done([frames, painted, mapod.live.window.version - version]);
  };
  requestAnimationFrame(frame);
}

/** A gamepad whose shoulder is held while `window.held` is true; its stick is pushed ahead. */
function plugGamepad() {
  window.held = false;
  const buttons = () => [0, 1, 2, 3, 4, 5].map((k) => ({ pressed: k === 5 && window.held }));
  navigator.getGamepads = () => [{ connected: true, axes: [0.05, -1], buttons: buttons() }];
}

/** A browser without WebGL 2. */
function hideWebgl() {
  const of = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
    return kind === "webgl2" ? null : of.call(this, kind, ...more);
  };
}
