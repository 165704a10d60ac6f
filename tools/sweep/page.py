"""One page of plots: each score by settings, the best marked, and how drives differ."""

import html
import math
import statistics
from collections.abc import Callable, Iterator, Sequence

from tools.sweep.scores import Score
from tools.sweep.tables import Line, best_of, scores_in

ROW_PX, WIDTH_PX, PAD_PX, TOP_PX = 22, 460, 12, 8
MOST_DOTS = 24  # drives; of more, a box from quarter to quarter tells
TICKS = 4
STYLE = """
:root { --ground: #fff; --ink: #1b1f24; --dim: #6a737d; --line: #d8dee4; --band: #f4f6f8;
  --dot: #0072b2; --best: #d55e00 }
@media (prefers-color-scheme: dark) { :root { --ground: #15181c; --ink: #e6e9ec; --dim: #9aa4ae;
  --line: #343b43; --band: #1d2227; --dot: #56b4e9; --best: #e69f00 } }
body { background: var(--ground); color: var(--ink); font: 15px/1.45 system-ui, sans-serif;
  margin: 2rem auto; max-width: 1080px; padding: 0 1rem }
h1 { font-size: 1.5rem; margin: 0 }
h2 { font-size: 1.05rem; margin: 2.2rem 0 .1rem }
p { margin: .2rem 0; color: var(--dim) }
svg { display: block; width: 100%; height: auto; margin-top: .4rem }
text { font: 12px system-ui, sans-serif; fill: var(--ink) }
.dim { fill: var(--dim) }
.best { fill: var(--best); font-weight: 600 }
.band { fill: var(--band) }
.grid { stroke: var(--line) }
.span { stroke: var(--dot); stroke-opacity: .45; stroke-width: 2 }
.dot { fill: var(--dot); fill-opacity: .55 }
.box { fill: var(--dot); fill-opacity: .3 }
.mean { stroke: var(--ink); stroke-width: 2 }
.mean.best { stroke: var(--best); stroke-width: 4 }
.wide { overflow-x: auto }
table { border-collapse: collapse; margin-top: 1rem; font-size: 13px }
th, td { padding: .25rem .6rem; text-align: right; border-bottom: 1px solid var(--line) }
th:first-child, td:first-child { text-align: left; white-space: nowrap }
td.best, b { color: var(--best); font-weight: 600 }
"""
FRAME = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{title}</title><style>{style}</style>
</head><body>
{body}
</body></html>
"""


def page_of(title: str, facts: str, lines: Sequence[Line], failures: Sequence[str]) -> str:
    """HTML that needs nothing else."""
    scores = scores_in(lines)
    body = [
        f"<h1>{html.escape(title)}</h1><p>{html.escape(facts)}</p>",
        "<p>Less is better in every score. A dot is a drive (of many drives: a box from quarter to "
        "quarter), the line goes from the least to the greatest, the upright mark is the mean over "
        "drives; the best mean is <b>marked</b>.</p>",
    ]
    for score in scores:
        about = f"{score.about}" + (" (against the truth)" if score.of_truth else "")
        body.append(f"<h2>{score.name}, {score.unit}</h2><p>{html.escape(about)}</p>")
        values = {value for line in lines for _, value in line.values.get(score.name, [])}
        same = f"<p>{figure_text(min(values))} in every drive, with all settings</p>"
        body.append(plot(score, lines) if len(values) > 1 else same)
    if scores:
        body.append("<h2>Means over drives</h2>" + _table(lines, scores))
    if failures:
        told = "".join(f"<li>{html.escape(line)}</li>" for line in failures)
        body.append(f"<h2>Without scores</h2><ul>{told}</ul>")
    return FRAME.format(title=html.escape(title), style=STYLE, body="\n".join(body))


def plot(score: Score, lines: Sequence[Line]) -> str:
    """One score as SVG: a row for each set of settings."""
    known = [value for line in lines for _, value in line.values.get(score.name, [])]
    low, high, ticks = _scale(min(known), max(known))
    label_px = min(420, 20 + 7 * max(len(line.name) for line in lines))
    width, height = label_px + WIDTH_PX + 90, TOP_PX + ROW_PX * len(lines) + 26
    best = best_of(lines, score)

    def x_of(value: float) -> float:
        return round(label_px + PAD_PX + (WIDTH_PX - 2 * PAD_PX) * (value - low) / (high - low), 1)

    bottom = TOP_PX + ROW_PX * len(lines)
    parts = [f'<svg viewBox="0 0 {width} {height}" role="img" aria-label="{score.name}">']
    for k in range(0, len(lines), 2):
        y = TOP_PX + ROW_PX * k
        parts.append(f'<rect class="band" x="0" y="{y}" width="{width}" height="{ROW_PX}"/>')
    for tick in ticks:
        x = x_of(tick)
        parts.append(f'<line class="grid" x1="{x}" x2="{x}" y1="{TOP_PX}" y2="{bottom}"/>')
        parts.append(
            f'<text class="dim" x="{x}" y="{bottom + 17}" text-anchor="middle">{tick:g}</text>'
        )
    for k, line in enumerate(lines):
        parts += _row(line, score, TOP_PX + ROW_PX * (k + 0.5), label_px, x_of, line in best)
    return "".join(parts) + "</svg>"


def _row(
    line: Line,
    score: Score,
    y: float,
    label_px: int,
    x_of: Callable[[float], float],
    is_best: bool,
) -> Iterator[str]:
    mark = " best" if is_best else ""
    name = html.escape(_shortened(line.name, label_px))
    yield f'<text class="{mark.strip()}" x="4" y="{y + 4}">{name}'
    yield f"<title>{html.escape(line.name)}</title></text>"
    given = line.values.get(score.name, [])
    if not given:
        yield f'<text class="dim" x="{label_px + PAD_PX}" y="{y + 4}">no drive has it</text>'
        return
    values = sorted(value for _, value in given)
    yield (f'<line class="span" x1="{x_of(values[0])}" x2="{x_of(values[-1])}" y1="{y}" y2="{y}"/>')
    if len(values) > MOST_DOTS:
        first, _, third = statistics.quantiles(values, n=4)
        x, width = x_of(first), max(1.0, x_of(third) - x_of(first))
        yield f'<rect class="box" x="{x}" y="{y - 5}" width="{width:.1f}" height="10"/>'
    else:
        for drive, value in given:
            yield f'<circle class="dot" cx="{x_of(value)}" cy="{y}" r="4">'
            yield f"<title>{html.escape(drive)}: {figure_text(value)} {score.unit}</title></circle>"
    mean = line.mean(score.name)
    x = x_of(mean)
    yield f'<line class="mean{mark}" x1="{x}" x2="{x}" y1="{y - 8}" y2="{y + 8}"/>'
    at, text = label_px + WIDTH_PX + 84, figure_text(mean)
    yield f'<text class="{mark.strip()}" x="{at}" y="{y + 4}" text-anchor="end">{text}</text>'


def _shortened(name: str, label_px: int) -> str:
    most = label_px // 7
    return name if len(name) <= most else name[: most - 1] + "…"


def _scale(low: float, high: float) -> tuple[float, float, list[float]]:
    """From, to, and round numbers between; from 0 on, unless all is far from it. low < high."""
    if low > 0.0 and low < 0.7 * high:
        low = 0.0
    step = 10.0 ** math.floor(math.log10((high - low) / TICKS))
    step *= next(k for k in (1, 2, 5, 10) if k * step * TICKS >= (high - low) * 0.99)
    first, last = math.floor(low / step), math.ceil(high / step)
    return first * step, last * step, [round(k * step, 12) for k in range(first, last + 1)]


def figure_text(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"


def _table(lines: Sequence[Line], scores: Sequence[Score]) -> str:
    head = "".join(f"<th>{score.name}<br>{score.unit}</th>" for score in scores)
    best = {score.name: best_of(lines, score) for score in scores}
    rows = []
    for line in lines:
        cells = "".join(
            f'<td class="{"best" if line in best[score.name] else ""}">'
            f"{figure_text(line.mean(score.name))}</td>"
            for score in scores
        )
        rows.append(f"<tr><td>{html.escape(line.name)}</td>{cells}</tr>")
    return f'<div class="wide"><table><tr><th>settings</th>{head}</tr>{"".join(rows)}</table></div>'
