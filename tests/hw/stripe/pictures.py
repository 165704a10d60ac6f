"""Pictures of a laser's line, drawn in numpy: nothing of hw/ in it."""

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
U8 = npt.NDArray[np.uint8]
SIGMA_PX = 1.4  # of the line's profile: 3.3 px at half its height


class Picture:
    """A grey scene, onto which light is put; `shot` is what the camera makes of it."""

    def __init__(self, seed: int, size: tuple[int, int] = (480, 640), grey: float = 60.0) -> None:
        self.rng, self.size = np.random.default_rng(seed), size
        self.rows = np.arange(size[0], dtype=np.float64)[:, None]
        self.columns = np.arange(size[1], dtype=np.float64)[None, :]
        self.light = np.full((*size, 3), grey)
        self.light += 20.0 * np.sin(self.columns / 37.0 + self.rows / 23.0)[:, :, None]

    def line(
        self, at_px: F64, level: float | F64 = 130.0, sigma_px: float = SIGMA_PX, channel: int = 2
    ) -> "Picture":
        """A line, its middle at a row (w,) of each column; NaN: none there."""
        profile = np.exp(-0.5 * ((self.rows - at_px[None, :]) / sigma_px) ** 2)
        self.light[:, :, channel] += level * np.nan_to_num(profile)
        return self

    def spot(
        self, v: float, u: float, radius_px: float, bgr: tuple[float, float, float]
    ) -> "Picture":
        away = np.hypot(self.rows - v, self.columns - u) / radius_px
        self.light += np.exp(-(away**4))[:, :, None] * np.array(bgr)
        return self

    def shot(self, noise: float = 5.0) -> U8:
        seen = self.light + self.rng.normal(0.0, noise, self.light.shape)
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)


def slope(width: int = 640) -> F64:
    """Rows of a line that runs slantwise, with a step and a bend."""
    u = np.arange(width, dtype=np.float64)
    rows = 150.0 + 0.13 * u + 12.0 * np.sin(u / 60.0)
    rows[u > width * 0.6] += 70.0
    return rows
