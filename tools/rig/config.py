"""`rig.toml` to a frozen, checked struct, or `ConfigError`: the bench of `make rig`.

Every key is required and no other is allowed. A real drive beside a fake scanner or attitude sensor
is refused unless the file says that the wheels are off the ground; a real drive takes nothing from
a scene, and never enters ground that was not seen.
"""

import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from core.config import ConfigError
from hw.ports.url import PortUrlError, parse_url

FAKE, BOARD, HOST, OF_SCENE = "fake", "board", "host", "scene"
SHEET, CLEAN = "sheet", "clean"
DEVICES = ("scanner", "ahrs", "drive")
MOST_SEED, MOST_M, MOST_CLEAR_M, MOST_MPS = 2**31 - 1, 1000, 20, 1
BAUDS = (115_200, 230_400, 460_800, 921_600)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigConfig:
    """What `make rig` puts together."""

    scene: str
    seed: int
    goals: tuple[tuple[float, float], ...]  # (x, y) m, map frame; (): the scene's
    sensors: str  # SHEET or CLEAN
    scanner: str  # FAKE, or a port; likewise
    ahrs: str
    drive: str
    planner: str  # BOARD, HOST, or a port
    wheels_off_the_ground: bool
    board_baud: int
    start_clear_m: float | None  # None: as the scene says
    unknown_mps: float
    config: str  # file of the app's settings

    @property
    def real(self) -> dict[str, str]:
        """The ports of the devices that are real, by name."""
        return {name: port for name in DEVICES if (port := getattr(self, name)) != FAKE}


def _text(value: Any) -> str:
    """A text that is not empty."""
    if not isinstance(value, str) or not value:
        raise ValueError("a text that is not empty")
    return value


def _one_of(*allowed: object) -> Callable[[Any], Any]:
    def check(value: Any) -> Any:
        if isinstance(value, bool) or value not in allowed:
            raise ValueError(" or ".join(repr(one) for one in allowed))
        return value

    return check


def _number(least: int, most: int, whole: bool = False) -> Callable[[Any], Any]:
    def check(value: Any) -> Any:
        right = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        if not right or not math.isfinite(value) or not least <= value <= most:
            raise ValueError(f"a {'whole ' if whole else ''}number from {least} to {most}")
        return value if whole else float(value)

    return check


def _switch(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError("true or false")
    return value


def _goals(value: Any) -> tuple[tuple[float, float], ...]:
    number, words = _number(-MOST_M, MOST_M), "a list of places [x_m, y_m], or []"
    if not isinstance(value, list):
        raise ValueError(words)
    goals = []
    for place in value:
        if not isinstance(place, list) or len(place) != 2:
            raise ValueError(words)
        goals.append((number(place[0]), number(place[1])))
    return tuple(goals)


def _port(*names: str) -> Callable[[Any], str]:
    """One of the names, or the URL of a port."""

    def check(value: Any) -> str:
        if value in names:
            return str(value)
        try:
            parse_url(value if isinstance(value, str) else "")
        except PortUrlError as error:
            named = " or ".join(repr(name) for name in names)
            raise ValueError(f"{named}, or a port ({error})") from None
        return str(value)

    return check


def _clear(value: Any) -> float | None:
    try:
        return None if value == OF_SCENE else float(_number(0, MOST_CLEAR_M)(value))
    except ValueError as error:
        raise ValueError(f"{OF_SCENE!r}, or {error}") from None


KEYS: Mapping[str, Mapping[str, Callable[[Any], Any]]] = {
    "world": {
        "scene": _text,
        "seed": _number(0, MOST_SEED, whole=True),
        "goals": _goals,
        "sensors": _one_of(SHEET, CLEAN),
    },
    "devices": {
        "scanner": _port(FAKE),
        "ahrs": _port(FAKE),
        "drive": _port(FAKE),
        "planner": _port(BOARD, HOST),
        "wheels_off_the_ground": _switch,
    },
    "planner": {
        "board_baud": _one_of(*BAUDS),
        "start_clear_m": _clear,
        "unknown_mps": _number(0, MOST_MPS),
    },
    "robot": {"config": _text},
}


def load_rig_config(text: str, changes: Mapping[str, Any] | None = None) -> RigConfig:
    """The bench that a rig.toml describes, with values at "section.key" replaced.

    Raises:
        ConfigError: no TOML; a key unknown, missing or with a wrong value; a blind drive.
    """
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not TOML: {error}") from None
    for name, value in (changes or {}).items():
        section, _, key = name.partition(".")
        table.setdefault(section, {})[key] = value
    for section in table.keys() - KEYS.keys():
        raise ConfigError(f"{section}: unknown; allowed are {', '.join(KEYS)}")
    values: dict[str, Any] = {}
    for section, keys in KEYS.items():
        values |= _section(section, table.get(section), keys)
    config = RigConfig(**values)
    _check_real_drive(config)
    return config


def _section(section: str, table: Any, keys: Mapping[str, Callable[[Any], Any]]) -> dict[str, Any]:
    """The checked values of one section."""
    if not isinstance(table, dict):
        raise ConfigError(f"{section}: missing; it is a section [{section}]")
    for key in table.keys() - keys.keys():
        raise ConfigError(f"{section}.{key}: unknown; allowed are {', '.join(keys)}")
    values = {}
    for key, check in keys.items():
        if key not in table:
            raise ConfigError(f"{section}.{key}: missing")
        try:
            values[key] = check(table[key])
        except ValueError as error:
            raise ConfigError(f"{section}.{key}: must be {error}, is {table[key]!r}") from None
    return values


def _check_real_drive(config: RigConfig) -> None:
    """No real wheels roll by what a fake has seen, or over ground that nobody has looked at."""
    if config.drive == FAKE:
        return
    blind = [name for name in ("scanner", "ahrs") if getattr(config, name) == FAKE]
    if blind and not config.wheels_off_the_ground:
        raise ConfigError(
            f"devices.wheels_off_the_ground: must be true, with a real drive beside a fake "
            f"{' and a fake '.join(blind)}: the robot would move without seeing where it goes"
        )
    if config.start_clear_m is None:
        raise ConfigError(
            "planner.start_clear_m: must be a number with a real drive: how far around the start "
            "somebody has looked at the ground; a scene knows nothing of it"
        )
    if config.unknown_mps > 0:
        raise ConfigError(
            "planner.unknown_mps: must be 0 with a real drive: it would go where nobody has seen "
            f"the ground, is {config.unknown_mps}"
        )


def load_rig_file(path: Path, changes: Mapping[str, Any] | None = None) -> RigConfig:
    """As load_rig_config; the app's settings are looked for beside the file.

    Raises:
        ConfigError: as there; a file that can't be read. The text begins with the file's name.
    """
    try:
        config = load_rig_config(path.read_text(encoding="utf-8"), changes)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: {error}") from None
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    beside = path.resolve().parent / config.config
    if not beside.is_file():
        raise ConfigError(
            f"{path}: robot.config: must be a file that is there, is {config.config!r}"
        )
    return replace(config, config=str(beside))
