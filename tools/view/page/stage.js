/** Pointer, touch, wheel and keys on the map and on the relief. */

const STEP_PX = 48,
  STEP_RAD = 0.12,
  ZOOM_STEP = 1.25;
const CLICK_PX = 5; // a press that moves less is a click
const TURN_RAD_PX = 0.008;
const ARROWS = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/** `on`: {drag(dx, dy, is_other), zoom(factor, x, y), hover(x, y) or hover(null), click(x, y), key(event)}. */
export function listenTo(canvas, on) {
  const held = new Map(); // pointer -> {x, y}
  let moved_px = 0;
  const at = (event) => {
    const { left, top } = canvas.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held.set(event.pointerId, at(event));
    moved_px = held.size > 1 ? CLICK_PX : 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = at(event),
      before = held.get(event.pointerId);
    if (!before) return on.hover(now.x, now.y);
    held.set(event.pointerId, now);
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    moved_px += Math.hypot(dx, dy);
    if (held.size === 2)
      return pinch([...held.entries()].find(([id]) => id !== event.pointerId)[1], before, now, on);
    if (moved_px >= CLICK_PX) on.drag(dx, dy, event.shiftKey || event.buttons === 2);
    return undefined;
  });
  const end = (event) => {
    if (held.delete(event.pointerId) && moved_px < CLICK_PX && event.type === "pointerup") {
      const { x, y } = at(event);
      on.click(x, y);
    }
  };
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, end);
  canvas.addEventListener("pointerleave", () => on.hover(null));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const { x, y } = at(event),
        lines = event.deltaMode === 1 ? 16 : 1;
      on.zoom(Math.exp(-event.deltaY * lines * 0.0016), x, y);
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => on.key(event));
}

/** Two fingers: they zoom by their distance and move by their middle. */
function pinch(other, before, now, on) {
  const apart = (from) => Math.max(10, Math.hypot(from.x - other.x, from.y - other.y));
  on.drag((now.x - before.x) / 2, (now.y - before.y) / 2, true);
  on.zoom(apart(now) / apart(before), (now.x + other.x) / 2, (now.y + other.y) / 2);
}

/** Keys of the map: arrows pan, + and - zoom, Enter pins the cell in the middle. */
export function mapKeys(view, { pinMiddle, unpin }) {
  return (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    if (event.key in ARROWS)
      view.pan(...ARROWS[event.key].map((way) => way * STEP_PX * (event.shiftKey ? 0.25 : 1)));
    else if (event.key === "+" || event.key === "=") view.zoom(ZOOM_STEP);
    else if (event.key === "-") view.zoom(1 / ZOOM_STEP);
    else if (event.key === "Enter") pinMiddle();
    else if (event.key === "Escape") unpin();
    else return false;
    event.preventDefault();
    return true;
  };
}

export function reliefKeys(camera) {
  return (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return false;
    if (event.key in ARROWS) {
      const [turn, tilt] = ARROWS[event.key];
      camera.turn(turn * STEP_RAD, tilt * STEP_RAD);
    } else if (event.key === "+" || event.key === "=") camera.zoom(ZOOM_STEP);
    else if (event.key === "-") camera.zoom(1 / ZOOM_STEP);
    else return false;
    event.preventDefault();
    return true;
  };
}

export function turnBy(camera, dx_px, dy_px) {
  camera.turn(-dx_px * TURN_RAD_PX, dy_px * TURN_RAD_PX);
}

/** Moves what the relief looks at, along the ground, as the picture is dragged. */
export function slideBy(camera, dx_px, dy_px, height_px) {
  const m_px = (0.78 * camera.away_m) / height_px,
    cos = Math.cos(camera.turn_rad),
    sin = Math.sin(camera.turn_rad);
  camera.x_m += m_px * (dx_px * sin - dy_px * cos);
  camera.y_m += m_px * (-dx_px * cos - dy_px * sin);
}
