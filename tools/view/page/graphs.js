/** Small graphs of the last minutes: lines over time, from 0 up, gaps where nothing is known. */

export const SHOWN_S = 180;

/** `lines`: [{values, colour, is_dashed}], all at `times_s`; `most`: at least so high. Gives the top. */
export function drawGraph(canvas, times_s, end_s, lines, most, colours) {
  const ratio = Math.min(2, window.devicePixelRatio || 1);
  const width = canvas.clientWidth,
    height = canvas.clientHeight;
  if (!width || !height) return most;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  const top = Math.max(most, ...lines.map(({ values }) => highest(values)));
  context.fillStyle = colours.grid;
  context.fillRect(0, height - 1, width, 1);
  for (let minute = 60; minute < SHOWN_S; minute += 60) {
    context.fillRect(width - (minute / SHOWN_S) * width, 0, 1, height);
  }
  const x = (t_s) => width - ((end_s - t_s) / SHOWN_S) * width;
  for (const line of lines) {
    drawLine(
      context,
      times_s.map(x),
      line.values.map((value) => height - 1.5 - (value / top) * (height - 4)),
      line,
    );
  }
  return top;
}

function highest(values) {
  return values.reduce((most, value) => (value > most ? value : most), 0);
}

function drawLine(context, xs, ys, { colour, is_dashed }) {
  context.beginPath();
  let is_down = false;
  ys.forEach((y, k) => {
    const is_known = Number.isFinite(y) && xs[k] >= -5;
    if (is_known && is_down && xs[k] - xs[k - 1] < 12) context.lineTo(xs[k], y);
    else if (is_known) context.moveTo(xs[k], y);
    is_down = is_known;
  });
  context.setLineDash(is_dashed ? [3, 2] : []);
  context.strokeStyle = colour;
  context.lineWidth = 1.4;
  context.lineJoin = "round";
  context.stroke();
}
