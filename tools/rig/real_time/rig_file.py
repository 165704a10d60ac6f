"""`rig.toml` to a frozen, checked struct, or `ConfigError`: the bench of `make rig`.

Every key is required and no other is allowed. A real drive beside a fake scanner or attitude sensor
is refused unless the file says that the wheels are off the ground; a real drive takes nothing from
a scene, and never enters ground that was not seen.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
from msgspec import Meta, Struct

from core.config import ConfigError
from hw.ports.url import PortUrlError, parse_url

FAKE, BOARD, HOST, OF_SCENE = "fake", "board", "host", "scene"
DEVICES = ("scanner", "ahrs", "drive")

Words = Annotated[str, Meta(min_length=1)]
Metres = Annotated[float, Meta(ge=-1000, le=1000)]
Clear = Annotated[float, Meta(ge=0, le=20)]


class World(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the robot drives."""

    scene: Words
    seed: Annotated[int, Meta(ge=0, le=2**31 - 1)]
    goals: list[tuple[Metres, Metres]]  # (x, y) m, map frame; none: the scene's
    sensors: Literal["sheet", "clean"]


class Devices(Struct, frozen=True, forbid_unknown_fields=True):
    """Which of them are real: a name of a fake, or a port."""

    scanner: Words
    ahrs: Words
    drive: Words
    planner: Words
    wheels_off_the_ground: bool

    def __post_init__(self) -> None:
        for name, fakes in (*((name, (FAKE,)) for name in DEVICES), ("planner", (BOARD, HOST))):
            given = getattr(self, name)
            try:
                if given not in fakes:
                    parse_url(given)
            except PortUrlError as error:
                allowed = " or ".join(map(repr, fakes))
                raise ValueError(
                    f"{name}: must be {allowed}, or a port ({error}), is {given!r}"
                ) from None

    @property
    def real(self) -> dict[str, str]:
        return {name: port for name in DEVICES if (port := getattr(self, name)) != FAKE}


class Planner(Struct, frozen=True, forbid_unknown_fields=True):
    """What the planner is told before it starts."""

    board_baud: Literal[115_200, 230_400, 460_800, 921_600]
    start_clear_m: Clear | Literal["scene"]
    unknown_mps: Annotated[float, Meta(ge=0, le=1)]


class Robot(Struct, frozen=True, forbid_unknown_fields=True):
    """The robot's own settings."""

    config: Words  # file of the app's


class RigConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """What `make rig` puts together: the whole of `rig.toml`."""

    world: World
    devices: Devices
    planner: Planner
    robot: Robot


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
    try:
        config = msgspec.convert(table, RigConfig)
    except msgspec.ValidationError as error:
        raise ConfigError(_message(error, table)) from None
    _check_real_drive(config)
    return config


def _message(error: msgspec.ValidationError, table: Mapping[str, Any]) -> str:
    words, _, path = str(error).partition(" - at `$")
    keys = path.strip(".`").partition("[")[0]
    if isinstance(error.__cause__, ValueError):  # a struct's own check, which names its key
        return f"{keys}.{words}"
    section, _, key = keys.partition(".")
    if not key:
        return f"{keys}: {words}" if keys else words
    if "enum value" in words:  # which would not say what is allowed
        kind = get_type_hints(get_type_hints(RigConfig)[section])[key]
        words = f"expected {kind}".replace("typing.", "")
    return f"{keys}: {words}, is {table[section][key]!r}"


def _check_real_drive(config: RigConfig) -> None:
    """No real wheels roll by what a fake has seen, or over ground that nobody has looked at."""
    devices, planner = config.devices, config.planner
    if devices.drive == FAKE:
        return
    blind = [name for name in ("scanner", "ahrs") if name not in devices.real]
    if blind and not devices.wheels_off_the_ground:
        raise ConfigError(
            f"devices.wheels_off_the_ground: must be true, with a real drive beside a fake "
            f"{' and a fake '.join(blind)}: the robot would move without seeing where it goes"
        )
    if planner.start_clear_m == OF_SCENE:
        raise ConfigError(
            "planner.start_clear_m: must be a number with a real drive: how far around the start "
            "somebody has looked at the ground; a scene knows nothing of it"
        )
    if planner.unknown_mps > 0:
        raise ConfigError(
            "planner.unknown_mps: must be 0 with a real drive: it would go where nobody has seen "
            f"the ground, is {planner.unknown_mps}"
        )


def load_rig_file(path: Path, changes: Mapping[str, Any] | None = None) -> RigConfig:
    """As load_rig_config, with the file's name in the error; the app's settings lie beside it."""
    try:
        config = load_rig_config(path.read_text(encoding="utf-8"), changes)
    except (OSError, UnicodeDecodeError, ConfigError) as error:
        raise ConfigError(f"{path}: {error}") from None
    beside = path.resolve().parent / config.robot.config
    if not beside.is_file():
        raise ConfigError(
            f"{path}: robot.config: must be a file that is there, is {config.robot.config!r}"
        )
    return msgspec.structs.replace(config, robot=Robot(str(beside)))
