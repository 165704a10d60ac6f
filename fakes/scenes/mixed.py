"""Scenes out of all scenes: rooms by chance, and in them things that any campaign scene has.

Which entries are taken, from which files, follows from the seed alone; where they then stand is
drawn as for every file. So a planner meets what nobody has put together for it.
"""

import tomllib
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

MIXED = "mixed"  # the name that such a scene has instead of a file's
HERE = Path(__file__).parent
ROOMS = {"count": [2, 3], "wide_m": [8.0, 15.0], "long_m": [8.0, 12.0], "door_m": [2.2, 3.4]}
ENTRIES = 6, 12  # of scatters, from and to
PEOPLE = 0.4  # share of scenes with somebody in them
PLACE = "x", "y"  # of an entry's own scene: not in rooms by chance
NORTH_DEG = 360.0


@cache
def elements() -> tuple[dict[str, Any], ...]:
    """What the campaign's scenes scatter, without its places; in the order of the alphabet."""
    found = []
    for path in sorted(HERE.glob("*.toml")):
        table = tomllib.loads(path.read_text("utf-8"))
        if table.get("campaign", False):
            found += [
                {key: value for key, value in entry.items() if key not in PLACE}
                for entry in table.get("scatter", [])
            ]
    return tuple(found)


@cache
def upsets() -> tuple[dict[str, Any], ...]:
    """What upsets the sensors of any of these scenes."""
    tables = [tomllib.loads(path.read_text("utf-8")) for path in sorted(HERE.glob("*.toml"))]
    return tuple(
        table["upsets"] for table in tables if table.get("campaign", False) and "upsets" in table
    )


def mixed_table(seed: int, choice: int) -> dict[str, Any]:
    """What a file would say of the scene of a seed.

    Args:
        choice: another one where nothing of the one before fits into its rooms.
    """
    random = np.random.default_rng([seed % 2**63, zlib.crc32(MIXED.encode()), choice])
    count = int(random.integers(ENTRIES[0], ENTRIES[1] + 1))
    chosen = set(random.permutation(len(elements()))[:count].tolist())
    walkers = [k for k, entry in enumerate(elements()) if entry["kind"] == "walker"]
    if random.random() < PEOPLE:
        chosen.add(walkers[int(random.integers(len(walkers)))])
    table: dict[str, Any] = {
        "description": "rooms by chance, with things of all scenes",
        "campaign": False,
        "mirror": True,
        "x_axis_east_of_north_deg": float(random.uniform(0.0, NORTH_DEG)),
        "rooms": ROOMS,
        "goals": {"count": [1, 2]},
        "scatter": [elements()[k] for k in sorted(chosen)],
    }
    if upsets() and random.random() < 0.5:
        table["upsets"] = upsets()[int(random.integers(len(upsets())))]
    return table
