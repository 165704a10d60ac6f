"""What a correction of ranges does, as PNG: by how much each target reads too far, and the curve.

Grey: with the present settings; blue: with the correction, with twice its error. A target that was
left out is red. The curve is what the correction takes away, where there is data for it.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from core.records import F64
from tools.calibration.ranges import TERMS, RangeFit, powers_of

SIZE_PX, LEFT_PX, RIGHT_PX, TOP_PX, LOW_PX = (720, 420), 64, 16, 28, 36
WHITE, BLACK, LINES = (255, 255, 255), (0, 0, 0), (225, 225, 225)
BEFORE, AFTER, WRONG = (130, 130, 130), (20, 60, 200), (215, 40, 40)
DOT_PX, TICKS = 4, 8
ROUND = (1.0, 2.0, 5.0, 10.0)  # times a power of ten: what is between two lines


def step_of(span: float) -> float:
    """Between two lines of a scale: a round number, `TICKS` of them or a few less.

    >>> step_of(7.2), step_of(0.03)
    (1.0, 0.005)
    """
    least = span / TICKS
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(power * k for k in ROUND if power * k >= least * (1 - 1e-9)))


class _Chart:
    """A sheet with scales: readings in m to the right, mm too far upwards."""

    def __init__(self, x_m: tuple[float, float], y_mm: tuple[float, float]) -> None:
        self.sheet = Image.new("RGB", SIZE_PX, WHITE)
        self.pen = ImageDraw.Draw(self.sheet)
        self._x, self._y = x_m, y_mm
        self._scales()

    def at(self, x_m: float, y_mm: float) -> tuple[float, float]:
        wide, high = SIZE_PX[0] - LEFT_PX - RIGHT_PX, SIZE_PX[1] - TOP_PX - LOW_PX
        right = (x_m - self._x[0]) / (self._x[1] - self._x[0])
        up = (y_mm - self._y[0]) / (self._y[1] - self._y[0])
        return LEFT_PX + wide * right, SIZE_PX[1] - LOW_PX - high * up

    def _scales(self) -> None:
        for x_m in _ticks(self._x):
            self.pen.line([self.at(x_m, self._y[0]), self.at(x_m, self._y[1])], fill=LINES)
            left, low = self.at(x_m, self._y[0])
            self.pen.text((left - 8, low + 6), f"{x_m:g}", fill=BLACK)
        for y_mm in _ticks(self._y):
            shade = BLACK if y_mm == 0 else LINES
            self.pen.line([self.at(self._x[0], y_mm), self.at(self._x[1], y_mm)], fill=shade)
            self.pen.text((8, self.at(0, y_mm)[1] - 6), f"{y_mm:+g} mm", fill=BLACK)
        self.pen.text((SIZE_PX[0] - 80, SIZE_PX[1] - 16), "read, m", fill=BLACK)

    def dot(self, x_m: float, y_mm: float, colour: tuple[int, int, int]) -> None:
        x, y = self.at(x_m, y_mm)
        self.pen.ellipse((x - DOT_PX, y - DOT_PX, x + DOT_PX, y + DOT_PX), fill=colour)

    def bar(self, x_m: float, low_mm: float, high_mm: float, colour: tuple[int, int, int]) -> None:
        self.pen.line([self.at(x_m, low_mm), self.at(x_m, high_mm)], fill=colour)


def _ticks(span: tuple[float, float]) -> list[float]:
    step = step_of(span[1] - span[0])
    first, last = int(np.ceil(span[0] / step)), int(np.floor(span[1] / step))
    return [round(k * step, 9) for k in range(first, last + 1)]


def draw(path: Path, found: RangeFit, before_m: F64, errors_m: F64) -> None:
    """before_m, errors_m: (n,) too far with the present settings; of the readings, 1 sigma."""
    reads_m = np.array([target.read_m for target in found.targets])
    curve_m = np.linspace(*found.correction_m, 200)
    taken_mm = -1000 * (powers_of(curve_m, TERMS) @ found.correction)
    before_mm, after_mm = 1000 * before_m, 1000 * found.off_m
    all_mm = np.concatenate([before_mm, after_mm, taken_mm, [0.0]])
    edge_mm, edge_m = 0.08 * np.ptp(all_mm) + 1.0, 0.04 * np.ptp(reads_m)
    chart = _Chart(
        (float(reads_m.min() - edge_m), float(reads_m.max() + edge_m)),
        (float(all_mm.min() - edge_mm), float(all_mm.max() + edge_mm)),
    )
    points = zip(curve_m.tolist(), taken_mm.tolist(), strict=True)
    chart.pen.line([chart.at(*point) for point in points], fill=BEFORE, width=2)
    for k, read_m in enumerate(reads_m.tolist()):
        colour, error_mm = WRONG if k == found.wrong else AFTER, 2000 * float(errors_m[k])
        chart.dot(read_m, float(before_mm[k]), BEFORE)
        chart.bar(read_m, float(after_mm[k]) - error_mm, float(after_mm[k]) + error_mm, colour)
        chart.dot(read_m, float(after_mm[k]), colour)
    title = "too far: grey as set now, blue corrected (+- 2 sigma), red left out"
    chart.pen.text((LEFT_PX, 8), title, fill=BLACK)
    chart.sheet.save(path)
