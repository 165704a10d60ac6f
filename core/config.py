"""`mapod.toml` to frozen, typed, checked structs, or `ConfigError`.

Every key is required and no other is allowed, so the file is complete and is its own manual.
A device's section has keys of its own for each driver: their structs come from outside, by name.
Port URLs are checked by `hw.ports.wires`.
Source: design, section 6.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import Struct

from core.allowed import LONGEST_SHOWN, allowed, shown
from core.coverage_settings import CoverageSettings, fault_of
from core.device_settings import Ahrs, Depth, Drive, Scanner
from core.map_settings import Certainty, Ground, Map, Obstacle, ShadowFilter
from core.object_settings import FrameSettings, ObjectMapSettings
from core.run_settings import Log, Loop, Modbus, Motion, Planner, Record, Robot

NO_DRIVE = "none"  # the driver of [drive] where nothing commands motors or counts wheels
NO_CAMERA = "none"  # that of [depth] where there is no depth camera

Keys = Mapping[str, Any]
Drivers = Mapping[str, Mapping[str, type[Struct]]]  # by section and driver: its own keys


class ConfigError(Exception):
    """A setting that can't be used; the text names the key, what was given and what is allowed."""


class Config(Struct, frozen=True, forbid_unknown_fields=True):
    """The whole of `mapod.toml`."""

    loop: Loop
    robot: Robot
    scanner: Scanner
    ahrs: Ahrs
    motion: Motion
    drive: Drive
    map: Map
    obstacle: Obstacle
    ground: Ground
    planner: Planner
    modbus: Modbus
    record: Record
    log: Log
    certainty: Certainty | None = None  # None: not in the file, and not the method
    shadow_filter: ShadowFilter | None = None  # likewise
    depth: Depth | None = None  # None: not in the file, so there is no camera
    objects: FrameSettings | None = None  # None: not in the file, and there is no camera
    object_map: ObjectMapSettings | None = None  # likewise
    coverage: CoverageSettings | None = None  # None: not in the file, and nothing is planned

    @property
    def has_camera(self) -> bool:
        """Whether a depth camera is looked at."""
        return self.depth is not None and self.depth.driver != NO_CAMERA


def config_from_text(text: str, drivers: Drivers) -> Config:
    """The settings in a TOML text.

    Raises:
        ConfigError: not TOML, or a key is unknown, missing, of a wrong type or out of range.
    """
    return _config_from(_table_in(text), drivers)


def _table_in(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except ValueError as error:  # also for a number of thousands of digits
        raise ConfigError(f"not valid TOML: {error}") from None
    except RecursionError:
        raise ConfigError("not valid TOML: lists or tables are nested too deeply") from None


def _bring_up_to_date(table: dict[str, Any]) -> list[str]:
    """Settings of earlier versions, also in recordings, as they are now; what was changed."""
    keys, changed = table.get("map"), []
    if isinstance(keys, dict):
        if keys.get("method") == "beams":
            keys["method"] = "surface"
            changed.append('map.method: "beams" is gone, "surface" takes its place')
        if "cell_value" in keys:
            value = keys.pop("cell_value")
            if value not in ("mean", "kalman"):
                raise ConfigError(f"map.cell_value: must be 'mean' or 'kalman', is {shown(value)}")
            changed.append("map.cell_value: is gone, every cell is filtered")
        if "filter_heights" not in keys:
            keys["filter_heights"] = False
            changed.append("map.filter_heights: is new, false is what there was before")
    if "motion" not in table:
        table["motion"] = {"source": "wheels"}
        changed.append('motion.source: is new, "wheels" is what there was before')
    drive = table.get("drive")
    if isinstance(drive, dict) and drive.get("driver") == "ax3500" and "radio" not in drive:
        drive["radio"] = True
        changed.append("drive.radio: is new, true is what there was before")
    coverage = table.get("coverage")
    if isinstance(coverage, dict) and "enough_lively" not in coverage and "enough" in coverage:
        coverage["enough_lively"] = coverage["enough"]
        changed.append("coverage.enough_lively: is new, enough is what there was before")
    return changed


def outdated_in(text: str) -> list[str]:
    """What a TOML text that has been read has of earlier versions, one line each."""
    return _bring_up_to_date(tomllib.loads(text))


def config_with(config: Config, drivers: Drivers, changes: Mapping[str, Keys]) -> Config:
    """The same settings with some keys changed, and checked together.

    Raises:
        ConfigError: as config_from_text.
    """
    table = table_from(config)
    for section, keys in changes.items():
        before = table.get(section, {})
        if keys.get("driver") not in (None, before.get("driver")):  # whose own keys go with it
            own = msgspec.to_builtins(getattr(config, section).options)
            before = {key: value for key, value in before.items() if key not in own}
        table[section] = {**before, **keys}
    return _config_from(table, drivers)


def table_from(config: Config) -> dict[str, dict[str, Any]]:
    """The settings as sections and keys, as they stand in the file."""
    table: dict[str, dict[str, Any] | None] = msgspec.to_builtins(config)
    given = {section: keys for section, keys in table.items() if keys is not None}
    for keys in given.values():
        keys.update(keys.pop("options", {}))
    return given


def _config_from(table: dict[str, Any], drivers: Drivers) -> Config:
    _bring_up_to_date(table)
    _check_keys(table, drivers)
    parts = {
        section: _convert(section, table[section], kind, drivers.get(section))
        for section, kind in _sections(table).items()
    }
    config = msgspec.convert(parts, Config)
    _check_finite(table)
    _check_together(config)
    return config


def _convert(
    section: str, given: Keys, kind: type[Struct], drivers: Mapping[str, type[Struct]] | None
) -> Struct:
    """One section; a device's with the keys of its driver as `options`."""
    if drivers is None:
        return _checked(section, given, kind)
    options = drivers[given["driver"]]
    own = {key: given[key] for key in _fields(options)}
    common = {key: value for key, value in given.items() if key not in own}
    return _checked(section, {**common, "options": _checked(section, own, options)}, kind)


def _checked(section: str, given: Keys, kind: type[Struct]) -> Struct:
    try:
        return msgspec.convert(given, kind)
    except msgspec.ValidationError as error:
        if isinstance(error.__cause__, ValueError):  # the struct's own check of keys together
            raise ConfigError(f"{section}.{error.__cause__}") from None
        key = str(error).rpartition("`$.")[2].rstrip("`").partition("[")[0]
        raise ConfigError(
            f"{section}.{key}: must be {allowed(_fields(kind)[key])}, is {shown(given[key])}"
        ) from None


def _fields(kind: type[Struct]) -> dict[str, Any]:
    return {field.name: field.type for field in msgspec.structs.fields(kind)}


def _sections(table: dict[str, Any]) -> dict[str, Any]:
    """Those that a file has or must have; of a method's own sections, if it names that method."""
    own = {"certainty": Certainty, "shadow_filter": ShadowFilter}
    of_camera = {"objects": FrameSettings, "object_map": ObjectMapSettings}
    optional = {"depth": Depth, "coverage": CoverageSettings}
    sections = {**_fields(Config), **own, **optional, **of_camera}
    left_out = set(optional)
    if _given(table, "map", "method") != "certainty":
        left_out |= own.keys()
    if _given(table, "depth", "driver") in (None, NO_CAMERA):
        left_out |= of_camera.keys()
    for name in left_out - table.keys():
        del sections[name]
    return sections


def _given(table: dict[str, Any], section: str, key: str) -> Any:
    """What a table says there, though nothing of it is checked yet."""
    keys = table.get(section)
    return keys.get(key) if isinstance(keys, dict) else None


def _check_keys(table: dict[str, Any], drivers: Drivers) -> None:
    """Unknown and missing sections and keys, all of them in one text."""
    faults = []
    sections = _sections(table)
    for section in [*table, *(name for name in sections if name not in table)]:
        if section not in sections:
            allowed_are = f"allowed are {', '.join(sections)}"
            faults.append(f"[{_name(section)}]: unknown section; {allowed_are}")
        elif not isinstance(table.get(section, {}), dict):
            faults.append(f"{section}: must be a section, is {shown(table[section])}")
        else:
            given, kind = table.get(section, {}), sections[section]
            faults += _faulty_keys(section, given, kind, drivers.get(section))
    if faults:
        raise ConfigError("; ".join(faults))


def _faulty_keys(
    section: str, given: Keys, kind: type[Struct], drivers: Mapping[str, type[Struct]] | None
) -> list[str]:
    """Unknown and missing keys of a section, and a driver that there is not."""
    keys, knows = [key for key in _fields(kind) if key != "options"], ""
    if drivers is not None and "driver" in given:
        driver = given["driver"]
        if not isinstance(driver, str) or driver not in drivers:
            allowed = " or ".join(map(repr, drivers))
            return [f"{section}.driver: must be {allowed}, is {shown(driver)}"]
        keys, knows = keys + list(_fields(drivers[driver])), f" for driver {driver!r}"
    elif drivers is not None:  # what its other keys mean depends on it
        return [f"{section}.driver: missing"]
    return [
        *(
            f"{section}.{_name(key)}: unknown key{knows}; allowed are {', '.join(keys)}"
            for key in given
            if key not in keys
        ),
        *(f"{section}.{key}: missing" for key in keys if key not in given),
    ]


def _name(key: str) -> str:
    """A key on one line, whatever its quotes hold."""
    return shown(key) if re.search(r"[^\w.-]", key) or len(key) > LONGEST_SHOWN else key


def _check_finite(table: dict[str, Any]) -> None:
    """NaN passes no range, infinities might: neither is a length or an angle."""
    for section, keys in table.items():
        for key, value in keys.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise ConfigError(f"{section}.{key}: must be a finite number, is {value}")


def _check_motion(config: Config) -> None:
    """What tells the place, what moves the body, and what each of it needs of the other."""
    source, drive = config.motion.source, config.drive
    if drive.driver == NO_DRIVE and drive.port:
        raise ConfigError(f'drive.port: must be "" with driver {NO_DRIVE!r}, is {drive.port!r}')
    if drive.driver != NO_DRIVE and not drive.port:
        raise ConfigError("drive.port: must be a text that is not empty, is ''")
    if drive.driver == NO_DRIVE and source != "external":
        raise ConfigError(
            f"motion.source: must be 'external' with drive.driver = {NO_DRIVE!r}, which counts "
            f"nothing, is {source!r}"
        )
    if config.robot.enable_motors and source != "wheels":
        raise ConfigError(
            "robot.enable_motors: must be false unless motion.source is 'wheels', for mapod drives "
            f"nothing else; is true with {source!r}"
        )


def _check_paths(config: Config) -> None:
    """Files and folders that are named, and may be off."""
    record = config.record
    named = {"planner.key_file": config.planner.key_file}
    named |= {"record.path": record.path, "record.flight": record.flight}
    for key, path in named.items():
        if "\0" in path:
            raise ConfigError(f"{key}: must be a path without NUL characters, is {shown(path)}")
    if record.path and not record.path.endswith(("/", ".mcap")):
        raise ConfigError(
            'record.path: must be a folder that ends with "/", or a file that ends with ".mcap", '
            f"is {shown(record.path)}"
        )


def _check_together(config: Config) -> None:
    """What only two keys together can break."""
    _check_motion(config)
    if fault := fault_of(config.coverage, config.robot, config.has_camera):
        raise ConfigError(f"coverage.{fault}")
    if config.depth is not None and (config.depth.driver == NO_CAMERA) != (not config.depth.port):
        allowed = '""' if config.depth.port else "a text that is not empty"
        driver, port = config.depth.driver, config.depth.port
        raise ConfigError(f"depth.port: must be {allowed} with driver {driver!r}, is {port!r}")
    spec = config.scanner.options.spec
    if config.obstacle.window_cells > config.map.cells:
        raise ConfigError(
            f"obstacle.window_cells: must be at most map.cells = {config.map.cells}, "
            f"is {config.obstacle.window_cells}"
        )
    if config.obstacle.soft_free_below_m > 0 and spec.echoes < 2:
        raise ConfigError(
            "obstacle.soft_free_below_m: needs a scanner that is set to tell two echoes of a beam, "
            f"for beams echo twice in soft things; is {config.obstacle.soft_free_below_m}, and "
            f"{config.scanner.driver!r} as set tells one"
        )
    if config.map.method == "reference_plane" and not spec.is_plane:
        raise ConfigError(
            'map.method: "reference_plane" needs a scanner of one plane, which '
            f"{config.scanner.driver!r} is not"
        )
    if config.map.method == "certainty" and spec.light_normal is None:
        raise ConfigError(
            'map.method: "certainty" needs a scanner whose returns all lie in one plane across its '
            f"way, and {config.scanner.driver!r} as set has none"
        )
    if config.certainty is not None and config.certainty.free_from > config.certainty.most:
        raise ConfigError(
            f"certainty.free_from: must be at most certainty.most = {config.certainty.most}, "
            f"is {config.certainty.free_from}"
        )
    if config.certainty is not None and config.certainty.cas_certainty >= config.certainty.most:
        raise ConfigError(
            f"certainty.cas_certainty: must be less than certainty.most = {config.certainty.most}, "
            f"is {config.certainty.cas_certainty}: no cell would be certain"
        )
    _check_paths(config)
    for key, ports in (("planner", config.planner.ports), ("modbus", config.modbus.ports)):
        if len(set(ports)) < len(ports):
            raise ConfigError(f"{key}.port: each port may be given once, is {ports}")
    if abs(config.map.cell_m * 1000 - round(config.map.cell_m * 1000)) > 1e-6:
        raise ConfigError(
            "map.cell_m: must be whole millimetres (the planner's wire counts them), "
            f"is {config.map.cell_m}"
        )
