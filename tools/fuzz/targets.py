"""All targets of the fuzzer by name: what each is, what it runs, and what is watched of it."""

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tools.fuzz import devices, link, maps, modbus, page, plans, recordings, settings

JOINED_BYTES = 512


@dataclass(frozen=True, slots=True)
class Target:
    """What is given bytes.

    Attributes:
        what: in words, for the table.
        run: takes one input; an AssertionError, or any other, is a finding.
        write_seeds: inputs to begin with, into a folder.
        marked: packages and modules whose branches guide the fuzzer.
    """

    what: str
    run: Callable[[bytes], int]
    write_seeds: Callable[[Path], None]
    marked: Sequence[str]
    needs: str = ""  # a module that mapod itself does without
    most: int = 0  # instructions that are run of one input; 0: it is no program
    joined: int = 0  # bytes of a long input's instructions, about

    @property
    def lacks(self) -> str:
        """The module that it needs and that is not installed; "": none."""
        there = not self.needs or importlib.util.find_spec(self.needs) is not None
        return "" if there else self.needs


def _device(name: str, what: str, *marked: str) -> Target:
    return Target(
        f"{what} `{name}`, codec and session",
        partial(devices.run_program, name),
        partial(devices.write_seeds, name),
        marked,
        devices.NEEDS.get(name, ""),
        devices.MOST_STEPS,
        JOINED_BYTES,
    )


TARGETS = {
    "lms111": _device("lms111", "scanner", "hw.lms1xx"),
    "mti": _device("mti", "attitude sensor", "hw.mti"),
    "ax3500": _device("ax3500", "controller", "hw.ax3500"),
    "urg04lx": _device("urg04lx", "scanner", "hw.urg04lx"),
    "stripe": _device("stripe", "camera", "hw.stripe"),
    "visionary": _device("visionary", "depth camera", "hw.visionary"),
    "kinect": _device("kinect", "depth camera", "hw.depth_images"),
    "folder": _device("folder", "depth images", "hw.depth_images"),
    "link": Target(
        "planner link, all that a planner may send",
        partial(link.run, has_key=False),
        link.write_seeds,
        ["hw.planner_link"],
        most=link.MOST_STEPS,
    ),
    "link-keyed": Target(
        "the same with a key",
        partial(link.run, has_key=True),
        link.write_seeds,
        ["hw.planner_link"],
        most=link.MOST_STEPS,
    ),
    "modbus": Target(
        "Modbus over TCP, UDP and a line",
        modbus.run,
        modbus.write_seeds,
        ["hw.modbus"],
        most=modbus.MOST_STEPS,
    ),
    "settings": Target(
        "settings and key file", settings.run, settings.write_seeds, ["config_file", "core.config"]
    ),
    "recording": Target(
        "recordings: MCAP and what is in it",
        recordings.run,
        recordings.write_seeds,
        ["recording"],
        most=recordings.MOST_STEPS,
    ),
    "map": Target(
        "saved maps, up to a map that goes on",
        maps.run,
        maps.write_seeds,
        ["core.saved"],
    ),
    "plan": Target(
        "floor plans: GeoJSON, Valetudo",
        plans.run,
        plans.write_seeds,
        ["tools.floorplans", "core.paths.geometry.space"],
        "shapely",
    ),
    "page": Target(
        "the live page: HTTP and sockets",
        page.run,
        page.write_seeds,
        ["tools.view"],
        "aiohttp",
        page.MOST_STEPS,
    ),
}
