"""Settings: the shipped file, every way of getting one wrong, drivers from elsewhere, keys."""

import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config_file import drivers, key_from_bytes, load_config, read_key, with_changes
from core.config import (
    Config,
    ConfigError,
    Drivers,
    config_from_text,
    outdated_in,
    table_from,
)
from hw.lms1xx.options import Lms1xxOptions
from tests import ROOT

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
TABLE = tomllib.loads(SHIPPED)
KEYS = [(section, key) for section, keys in TABLE.items() for key in keys]


def toml_from(table: dict[str, Any]) -> str:
    lines = []
    for section, keys in table.items():
        lines.append(f"[{section}]")
        for key, value in keys.items():
            text = str(value).lower() if isinstance(value, bool) else repr(value)
            lines.append(f"{key} = {text}".replace("'", '"'))
    return "\n".join(lines)


def with_value(section: str, key: str, value: Any) -> str:
    return toml_from({**TABLE, section: {**TABLE[section], key: value}})


def error_of(text: str) -> str:
    with pytest.raises(ConfigError) as error:
        load_config(text)
    return str(error.value)


def test_the_shipped_file_is_the_papers_robot_that_never_moves() -> None:
    config = load_config(SHIPPED)
    scanner, options = config.scanner, config.scanner.options
    assert isinstance(options, Lms1xxOptions)
    assert (scanner.mount_z_m, scanner.mount_tilt_deg) == (1.08, 7.5)
    assert (options.first_deg, options.last_deg, options.angular_step_deg) == (30.0, 150.0, 0.25)
    assert (config.map.cells, config.map.cell_m, config.obstacle.window_cells) == (101, 0.2, 101)
    assert (config.obstacle.h_pos_m, config.obstacle.h_neg_m) == (0.10, -0.10)
    assert (config.loop.rate_hz, config.robot.encoder_ppr) == (200, 500)
    assert (config.robot.enable_motors, config.robot.unknown_stops) == (False, True)
    assert config.robot.start_clear_m == 0.0
    assert table_from(config) == TABLE
    with pytest.raises(AttributeError):
        config.loop.rate_hz = 100  # type: ignore[misc]


@pytest.mark.parametrize("section", TABLE)
def test_missing_unknown_and_mistyped_keys_are_named(section: str) -> None:
    assert f"{section}.colour: unknown key" in error_of(with_value(section, "colour", 1))
    for key in TABLE[section]:
        left = {k: v for k, v in TABLE[section].items() if k != key}
        if key not in (
            "filter_heights",
            "radio",
            "enough_lively",
        ):  # which files of earlier versions lack
            assert f"{section}.{key}: missing" in error_of(toml_from({**TABLE, section: left}))
        told = error_of(with_value(section, key, [["x"]]))
        assert told.startswith(f"{section}.{key}: must be ")
        assert told.endswith("is [['x']]")


def test_unknown_and_missing_sections_and_what_is_no_toml_are_named() -> None:
    told = error_of(SHIPPED.replace("[log]", "[logs]"))
    assert "[logs]: unknown section" in told
    assert "log.level: missing" in told
    assert "line 2" in error_of("[loop]\nrate_hz = \n")


def test_a_list_of_numbers_that_is_too_short_is_told() -> None:
    text = (ROOT / "robots" / "urg04lx.toml").read_text(encoding="utf-8")
    short = text.replace("correction = [0.0, 0.0, 0.0, 0.0]", "correction = [0.0]")
    assert error_of(short) == "scanner.correction: must be a list of 4 numbers, is [0.0]"


def test_what_a_depth_camera_sees_is_set_where_there_is_one() -> None:
    own = {
        "control": "cola_2", "period_s": 0.05, "level": "none", "password": "",
        "min_confidence": 6554, "latency_s": 0.03,
    }  # fmt: skip
    camera = {**TABLE["depth"], "driver": "visionary", "port": "tcp://192.168.1.10:2122", **own}
    of_camera = "depth", "objects", "object_map"
    blind = {section: keys for section, keys in TABLE.items() if section not in of_camera}
    assert not load_config(toml_from(blind)).has_camera
    assert load_config(toml_from({**TABLE, "depth": camera})).has_camera
    told = error_of(toml_from({**blind, "depth": camera}))
    assert "objects.voxel_m: missing" in told
    assert "object_map.cell_m: missing" in told
    told = error_of(toml_from({**TABLE, "depth": {**camera, "port": ""}}))
    assert told == "depth.port: must be a text that is not empty with driver 'visionary', is ''"


def test_paths_are_planned_for_who_has_a_camera_and_for_a_disc_that_holds_the_machine() -> None:
    text = (ROOT / "robots" / "cleaner.toml").read_text(encoding="utf-8")
    narrow = text.replace("radius_m = 0.35 ", "radius_m = 0.34 ")
    assert error_of(narrow).startswith(
        "coverage.radius_m: must be at least 0.3499, to the farthest"
    )
    blind = {section: keys for section, keys in TABLE.items() if section != "coverage"}
    assert load_config(toml_from(blind)).coverage is None
    told = error_of(with_value("coverage", "plan", True))
    assert told.startswith("coverage.plan: must be false without a depth camera")


@pytest.mark.parametrize(
    ("section", "key", "value", "told"),
    [
        ("loop", "rate_hz", 5, "from 10 to 1000, is 5"),
        ("loop", "rate_hz", True, "a number from 10 to 1000, is True"),
        ("robot", "encoder_ppr", 0, "a whole number from 1 to 100000, is 0"),
        ("robot", "enable_motors", 1, "true or false, is 1"),
        ("robot", "brake_mps2", 0.0, "from 0.01 to 20, is 0.0"),
        ("scanner", "driver", "lms222", "must be 'lms111' or 'urg04lx' or 'stripe', is 'lms222'"),
        ("scanner", "colour", 1, "unknown key for driver 'lms111'; allowed are driver, port,"),
        ("scanner", "mount_z_m", 0.0, "above 0 to 5, is 0.0"),
        ("scanner", "scan_rate_hz", 30, "25 or 50, is 30"),
        ("scanner", "angular_step_deg", 0.1, "0.25 or 0.5 at 25 Hz, is 0.1 at 25 Hz"),
        ("scanner", "last_deg", 30.0, "above first_deg = 30.0, is 30.0"),
        ("scanner", "port", "", "not empty, is ''"),
        ("motion", "source", "legs", "'external' or 'rail' or 'wheels', is 'legs'"),
        ("drive", "port", "", "not empty, is ''"),
        ("drive", "invert", [3], "a list, each of it 1 or 2, is [3]"),
        ("scanner", "accepted_status", [1], "a list of whole numbers from 2 to 255, is [1]"),
        ("drive", "right_channel", 1, "must differ from left_channel = 1, is 1"),
        ("map", "cell_value", "certainty", "'mean' or 'kalman', is 'certainty'"),
        ("map", "cells", 101.0, "a whole number from 3 to 2001, is 101.0"),
        ("map", "cell_m", float("nan"), "from 0.005 to 1, is nan"),
        ("map", "cell_m", 0.0333, "whole millimetres"),
        ("map", "cell_m", 0.004, "from 0.005 to 1, is 0.004"),
        ("depth", "driver", "eye", "'none' or 'visionary' or 'kinect' or 'folder', is 'eye'"),
        ("depth", "port", "tcp://a:1", "must be \"\" with driver 'none', is 'tcp://a:1'"),
        ("objects", "voxel_m", 0.0, "from 0.005 to 0.2, is 0.0"),
        ("object_map", "confirm_frames", 1, "from 2 to 100, is 1"),
        ("coverage", "overlap_m", 0.5, "at most 0.8 of width_m = 0.6, is 0.5"),
        ("coverage", "tries", 0, "from 1 to 1000, is 0"),
        ("certainty", "free_from", 51, "at most certainty.most = 50, is 51"),
        ("certainty", "cas_certainty", 50, "less than certainty.most = 50, is 50"),
        ("obstacle", "soft_free_below_m", 0.3, "two echoes of a beam"),
        ("obstacle", "h_neg_m", 0.1, "is 0.1"),
        ("obstacle", "window_cells", 103, "at most map.cells = 101, is 103"),
    ],
)
def test_a_value_out_of_range_is_told_with_its_range(
    section: str, key: str, value: Any, told: str
) -> None:
    error = error_of(with_value(section, key, value))
    assert told in error
    assert key in error


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"drive": {"driver": "none", "port": ""}},
            "motion.source: must be 'external' with drive.",
        ),
        (
            {"drive": {"driver": "none"}, "motion": {"source": "external"}},
            'drive.port: must be "" ',
        ),
        (
            {"motion": {"source": "rail"}, "robot": {"enable_motors": True}},
            "robot.enable_motors: must be false unless motion.source is 'wheels'",
        ),
    ],
)
def test_what_tells_the_place_and_what_moves_the_body_fit_together(
    changes: dict[str, dict[str, Any]], told: str
) -> None:
    with pytest.raises(ConfigError, match="must be") as error:
        with_changes(load_config(SHIPPED), **changes)
    assert str(error.value).startswith(told)


def test_settings_from_before_there_was_motion_are_of_wheels() -> None:
    old = toml_from({name: keys for name, keys in TABLE.items() if name != "motion"})
    assert load_config(old) == load_config(SHIPPED)
    assert [told.split(":")[0] for told in outdated_in(old)] == ["motion.source"]


def test_a_file_of_an_earlier_version_is_read_and_what_has_gone_is_told() -> None:
    old = SHIPPED.replace('method = "surface"', 'method = "beams"\ncell_value = "kalman"')
    old = old.replace("filter_heights = false", "")
    new = ("radio = true", "enough_lively = ")
    old = "\n".join(line for line in old.split("\n") if not line.startswith(new))
    shipped = load_config(SHIPPED)
    assert shipped.coverage is not None
    enough = {"coverage": {"enough_lively": shipped.coverage.enough}}
    assert load_config(old) == with_changes(shipped, **enough)
    told = outdated_in(old)
    assert len(told) == 5
    assert told[4].startswith("coverage.enough_lively: is new, enough")
    assert told[3].startswith("drive.radio: is new, true")
    assert told[2].startswith("map.filter_heights: is new, false")
    assert told[0].startswith('map.method: "beams" is gone')
    assert told[1].startswith("map.cell_value: is gone")
    assert outdated_in(SHIPPED) == []
    assert "map: must be a section" in error_of("map = 3")


def test_the_section_of_a_method_may_be_left_out_where_another_is_named() -> None:
    left = {section: keys for section, keys in TABLE.items() if section != "certainty"}
    config = load_config(toml_from(left))
    assert config.certainty is None
    assert table_from(config) == left
    left["map"] = {**left["map"], "method": "certainty"}
    assert "certainty.gain: missing" in error_of(toml_from(left))
    with pytest.raises(ConfigError, match=r"certainty.gain: missing"):
        with_changes(config, map={"method": "certainty"})


VALUES: st.SearchStrategy[Any] = st.one_of(
    st.integers(), st.floats(), st.booleans(), st.text(alphabet="abc", max_size=4), st.just([])
)


@given(place=st.sampled_from(KEYS), value=VALUES)
def test_any_value_anywhere_gives_settings_or_an_error_that_names_the_key(
    place: tuple[str, str], value: Any
) -> None:
    told = ""
    config: Config | None = None
    try:
        config = load_config(with_value(*place, value))
    except ConfigError as error:
        told = str(error)
    assert config is not None or place[1] in told or "TOML" in told
    if config is not None:
        assert table_from(config)[place[0]][place[1]] == value


class SonarOptions(msgspec.Struct, frozen=True):
    """The keys of an attitude sensor that nobody sells."""

    pings: int

    def describe(self) -> str:
        return f"{self.pings} pings"


def test_another_driver_has_keys_of_its_own_and_not_those_of_its_neighbour() -> None:
    known: Drivers = {**drivers(), "ahrs": {**drivers()["ahrs"], "sonar": SonarOptions}}
    mounts = {key: value for key, value in TABLE["ahrs"].items() if key.startswith("mount")}
    ahrs = {"driver": "sonar", "port": "tcp://10.0.0.1:1", **mounts, "pings": 3}
    config = config_from_text(toml_from({**TABLE, "ahrs": ahrs}), known)
    assert config.ahrs.options.describe() == "3 pings"
    with pytest.raises(ConfigError, match=r"ahrs.rate_hz: unknown key for driver 'sonar'; allowed"):
        config_from_text(toml_from({**TABLE, "ahrs": {**ahrs, "rate_hz": 100}}), known)
    with pytest.raises(ConfigError, match=r"ahrs.driver: must be 'mti', is 'sonar'"):
        with_changes(config, map={"cells": 201})  # by the drivers that are registered


def test_a_key_is_32_bytes_or_64_hex_digits_and_half_of_them_are_not_taken_for_bytes() -> None:
    for content in (bytes(range(32)), b"ab" * 32 + b"\n"):
        assert len(key_from_bytes(content, "key")) == 32
    for content, told in (
        (b"ab" * 20, "must hold 64 hex digits, 'key' holds 40"),
        (b"0123456789abcdef0123456789abcdef", "must hold 64 hex digits, 'key' holds 32"),
        (b"short", "must hold 32 bytes or 64 hex digits, 'key' holds 5 bytes"),
    ):
        with pytest.raises(ConfigError, match=told):
            key_from_bytes(content, "key")


def test_a_key_that_others_may_read_or_write_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "key"
    path.write_bytes(bytes(range(32)))
    for mode in (0o600, 0o400):
        path.chmod(mode)
        assert read_key(str(path)) == bytes(range(32))
    for mode in (0o640, 0o604, 0o620, 0o644):
        path.chmod(mode)
        with pytest.raises(ConfigError, match=rf"only its owner .* is {mode:04o}: chmod 600"):
            read_key(str(path))
    assert read_key("") is None
