"""The settings as shipped, with changes, and the floor of a hall: for tests of the whole app."""

from typing import Any

from config_file import load_config, with_changes
from core.config import Config
from fakes.scenes.scene import Solid
from tests import ROOT

TEXT = (ROOT / "mapod.toml").read_text(encoding="utf-8")
FLOOR = Solid("floor", (-20.0, 40.0), (-20.0, 20.0), (-1.0, 0.0))


def shipped(**sections: dict[str, Any]) -> Config:
    return with_changes(load_config(TEXT), **sections)
