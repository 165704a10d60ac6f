"""Which settings are tried: each value of each key with each other one, or so many by chance.

map.cell_m=0.1,0.2             a list
obstacle.h_pos_m=0.08:0.12:3   so many values from here to there, both ends too
obstacle.h_pos_m=0.08:0.12     any value between, for samples by chance
map.method=surface             one for all
"""

import itertools
import math
import random
import re
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

MOST_SETTINGS = 10_000
MOST_STEPS = 1000
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SPAN = re.compile(rf"({NUMBER}):({NUMBER})(?::(\d+))?")
KEY = re.compile(r"(\w+)\.(\w+)")

Settings = dict[str, Any]  # by "section.key"


class SpaceError(Exception):
    """These settings cannot be tried; the text says why."""


@dataclass(frozen=True, slots=True)
class Axis:
    """The values of one key: a list, or a span of which any value may be drawn."""

    key: str
    values: tuple[Any, ...] = ()
    span: tuple[float, float] | None = None

    def drawn(self, chance: random.Random) -> Any:
        if self.span is not None:
            return float(f"{chance.uniform(*self.span):.6g}")
        return chance.choice(self.values)


def axis_from_text(text: str) -> Axis:
    """Raises SpaceError."""
    key, equals, given = text.partition("=")
    key, given = key.strip(), given.strip()
    if not equals or not given or not KEY.fullmatch(key):
        raise SpaceError(f"--set {text}: must be section.key=value,value or section.key=from:to:n")
    if span := SPAN.fullmatch(given):
        return _spanned(key, text, span)
    values = _values(given)
    return Axis(key, tuple(value for k, value in enumerate(values) if value not in values[:k]))


def _spanned(key: str, text: str, span: "re.Match[str]") -> Axis:
    low, high = float(span[1]), float(span[2])
    if not low < high < math.inf:
        raise SpaceError(f"--set {text}: must go from a number to a greater one")
    if span[3] is None:
        return Axis(key, span=(low, high))
    count = int(span[3])
    if not 2 <= count <= MOST_STEPS:
        raise SpaceError(f"--set {text}: must have 2 to {MOST_STEPS} values, has {count}")
    values = [float(f"{low + (high - low) * k / (count - 1):.12g}") for k in range(count)]
    if re.fullmatch(r"[-+]?\d+:[-+]?\d+:\d+", span[0]) and all(x.is_integer() for x in values):
        return Axis(key, tuple(int(x) for x in values))
    return Axis(key, tuple(values))


def _values(text: str) -> list[Any]:
    """As TOML has them; words need no quotes."""
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except tomllib.TOMLDecodeError:
        return [_word(part.strip()) for part in text.split(",")]


def _word(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def settings_of(texts: Sequence[str], sample: int | None, seed: int) -> list[Settings]:
    """All that are to be tried, none twice; without texts one, which changes nothing.

    Raises SpaceError.
    """
    axes = [axis_from_text(text) for text in texts]
    for one, other in itertools.combinations(axes, 2):
        if one.key == other.key:
            raise SpaceError(f"--set {one.key}: is given twice")
    if sample is None:
        return list(_grid(axes))
    chance = random.Random(seed)
    drawn = [{axis.key: axis.drawn(chance) for axis in axes} for _ in range(sample)]
    return [settings for k, settings in enumerate(drawn) if settings not in drawn[:k]]


def _grid(axes: Sequence[Axis]) -> Iterator[Settings]:
    for axis in axes:
        if axis.span is not None:
            low, high = axis.span
            raise SpaceError(
                f"--set {axis.key}={low:g}:{high:g}: say how many values ({low:g}:{high:g}:5), "
                "or draw some with --sample"
            )
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST_SETTINGS:
        raise SpaceError(
            f"{count} settings are more than {MOST_SETTINGS}: try some of them with --sample"
        )
    for values in itertools.product(*(axis.values for axis in axes)):
        yield {axis.key: value for axis, value in zip(axes, values, strict=True)}


def sections_of(settings: Settings) -> dict[str, dict[str, Any]]:
    """As `config_file.with_changes` takes them."""
    found: dict[str, dict[str, Any]] = {}
    for name, value in settings.items():
        section, _, key = name.partition(".")
        found.setdefault(section, {})[key] = value
    return found
