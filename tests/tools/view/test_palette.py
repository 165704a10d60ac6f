"""The page's colours, for all eyes: read from its style sheet, computed here."""

import re

import numpy as np
import numpy.typing as npt
import pytest

from tests import ROOT

F64 = npt.NDArray[np.float64]
SHEET = (ROOT / "tools" / "view" / "page" / "page.css").read_text(encoding="utf-8")
THEMES = {"light": r":root \{(.*?)\}", "dark": r":root\[data-theme=\"dark\"\] \{(.*?)\}"}
# Machado, Oliveira, Fernandes, "A physiologically-based model for simulation of color vision
# deficiency", 2009: the whole of a deficiency, on linear RGB.
EYES = {
    "usual": [1, 0, 0, 0, 1, 0, 0, 0, 1],
    "deuteranopia": [
        0.367322, 0.860646, -0.227968,
        0.280085, 0.672501, 0.047413,
        -0.011820, 0.042940, 0.968881,
    ],
    "protanopia": [
        0.152286, 1.052583, -0.204868,
        0.114503, 0.786281, 0.099216,
        -0.003882, -0.048116, 1.051998,
    ],
    "tritanopia": [
        1.255528, -0.076749, -0.178779,
        -0.078411, 0.930809, 0.147602,
        0.004733, 0.691367, 0.303900,
    ],
}  # fmt: skip
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def colours(theme: str) -> dict[str, F64]:
    """Linear RGB of each `--name: #rrggbb` of a theme; what both themes share is in both."""
    found = {}
    for name in ("light", theme):
        [block] = re.findall(THEMES[name], SHEET, re.DOTALL)
        for key, code in re.findall(r"--([\w-]+): #([0-9a-f]{6});", block):
            share = np.array([int(code[k : k + 2], 16) for k in (0, 2, 4)]) / 255
            found[key] = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return found


def luminance(linear: F64) -> float:
    return float(np.clip(linear, 0.0, 1.0) @ LUMINANCE)


def lightness(linear: F64) -> float:
    """L* of CIELAB, 0 to 100."""
    y = luminance(linear)
    return 116 * y ** (1 / 3) - 16 if y > 0.008856 else 903.3 * y


def contrast(a: F64, b: F64) -> float:
    """Of WCAG 2, 1 to 21."""
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("eyes", EYES)
@pytest.mark.parametrize("theme", THEMES)
def test_cells_differ_by_lightness_alone_for_all_eyes(theme: str, eyes: str) -> None:
    of, through = colours(theme), np.array(EYES[eyes]).reshape(3, 3)
    seen = {
        name: lightness(through @ of[f"map-{name}"]) for name in ("unknown", "free", "obstacle")
    }
    assert abs(seen["free"] - seen["unknown"]) > 12
    assert abs(seen["obstacle"] - seen["free"]) > 35
    assert abs(seen["obstacle"] - seen["unknown"]) > 35


@pytest.mark.parametrize("theme", THEMES)
def test_what_was_free_is_far_from_free_and_has_no_colour(theme: str) -> None:
    of = colours(theme)
    assert abs(lightness(of["map-stale-free"]) - lightness(of["map-free"])) > 8
    for name in ("map-stale-free", "map-stale-obstacle"):
        assert max(of[name]) < 1.3 * min(of[name]), name


@pytest.mark.parametrize("theme", THEMES)
def test_text_can_be_read(theme: str) -> None:
    of = colours(theme)
    grounds = ("panel", "raised", "back")
    for ink in ("ink", "quiet", "ok", "warn", "bad"):
        for ground in grounds:
            assert contrast(of[ink], of[ground]) >= 4.5, (ink, ground)
    for ink, ground in (
        ("bad", "bad-back"),
        ("warn", "warn-back"),
        ("ink", "bad-back"),
        ("accent-ink", "accent"),
    ):
        assert contrast(of[ink], of[ground]) >= 4.5, (ink, ground)
    assert contrast(of["focus"], of["panel"]) >= 3.0
