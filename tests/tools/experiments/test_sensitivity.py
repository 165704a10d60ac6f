"""Halving and doubling constants: which there are, what becomes of them, and how it is judged."""

import math
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from core.mapping.surface import constants as shipped
from tools.experiments.sensitivity import (
    COLOURS,
    Rows,
    constants,
    draw,
    judged,
    keep,
    kept_in,
    main,
    scaled,
)


def values(text: str) -> dict[str, Any]:
    found: dict[str, Any] = {}
    exec(text, found)
    return found


@pytest.mark.parametrize("name", constants())
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_one_constant_is_scaled_with_what_follows_from_it(name: str, factor: float) -> None:
    changed = values(scaled(name, factor))
    old, new = getattr(shipped, name), changed[name]
    assert type(old) is type(new)
    if type(old) is int:
        assert new == max(1, round(old * factor))
    else:
        assert new == pytest.approx(old * factor)
    others = [other for other in constants() if other != name]
    assert [changed[other] for other in others] == [getattr(shipped, other) for other in others]
    assert changed["STEEP"] == changed["STEEPEST"] / changed["GATE"]


BEFORE: Rows = {
    "7 ramps, false cells": (10.0, "less"),
    "7 ramps, cells told free on an obstacle": (0.0, "less"),
    "7 ditches, bars the way": (7.0, "more"),
    "7 glass, told": (math.nan, "more"),
    "7 glass, so far ahead": (5.0, "none"),
}


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"7 ramps, false cells": 8.0}, "better"),
        ({"7 ramps, false cells": 12.0}, "worse"),
        ({"7 ramps, cells told free on an obstacle": 1.0}, "unsafe"),
        ({"7 ditches, bars the way": 6.0}, "worse"),
        ({"7 ditches, bars the way": 0.0}, "unsafe"),
        ({"7 ramps, false cells": 10.1}, "same"),
        ({"7 glass, so far ahead": 9.0, "7 glass, told": 9.0}, "same"),
    ],
)
def test_what_changes_is_better_worse_or_unsafe(
    changes: dict[str, float], kind: str, tmp_path: Path
) -> None:
    after = {key: (changes.get(key, value), aim) for key, (value, aim) in BEFORE.items()}
    found = judged(BEFORE, after)
    assert [key for key, rows in found.items() if rows] == ([kind] if kind != "same" else [])
    draw(tmp_path / "it.png", {("GATE", 0.5): found, ("GATE", 2.0): judged(BEFORE, BEFORE)})
    colours = {colour for _, colour in Image.open(tmp_path / "it.png").getcolors() or []}
    assert {COLOURS[kind], COLOURS["same"]} <= colours


def test_what_was_found_is_kept_and_not_run_again(tmp_path: Path) -> None:
    path, found = tmp_path / "kept.json", {"better": ["a"], "worse": [], "unsafe": []}
    told = {("GATE", 0.5): found, ("GATE", 2.0): found}
    keep(path, told)
    assert kept_in(path) == told
    assert kept_in(tmp_path / "none.json") == {}
    assert main(["--constants", "GATE", "--kept", str(path)]) == 0
