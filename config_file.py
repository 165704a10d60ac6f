"""The settings file and the key file, read with the keys that each registered driver knows."""

import contextlib
import json
import os
import stat
from pathlib import Path
from typing import Any

from core.config import Config, ConfigError, Drivers, config_from_text, config_with, table_from
from hw.registry import ATTITUDE_SENSORS, DEPTH_CAMERAS, DRIVES, SCANNERS

KEY_BYTES = 32
MOST_BYTES = 1_000_000  # of a settings file: fifty times the longest
OTHERS = stat.S_IRWXG | stat.S_IRWXO


def drivers() -> Drivers:
    """The structs of the keys of each driver that is registered now, by section and name."""
    return {
        "scanner": {name: driver.options for name, driver in SCANNERS.items()},
        "ahrs": {name: driver.options for name, driver in ATTITUDE_SENSORS.items()},
        "drive": {name: driver.options for name, driver in DRIVES.items()},
        "depth": {name: driver.options for name, driver in DEPTH_CAMERAS.items()},
    }


def load_config(text: str) -> Config:
    """The settings in a TOML text; ConfigError names the key that can't be."""
    return config_from_text(text, drivers())


def read_settings(path: Path) -> str:
    """The text of a settings file, not looked at yet. Raises ConfigError: can't be read."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise ConfigError(f"must be at most {MOST_BYTES} bytes long, is longer")
        return content.decode("utf-8-sig")  # with or without the mark that some editors put first
    except FileNotFoundError as error:
        raise ConfigError(f"{error.strerror}; mapod init writes one") from None
    except OSError as error:
        raise ConfigError(f"can't be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"must be UTF-8 text: {error}") from None


def with_changes(config: Config, **sections: dict[str, Any]) -> Config:
    """The same settings with some keys changed, `map={"cells": 401}`, and checked together."""
    return config_with(config, drivers(), sections)


def text_from(config: Config) -> str:
    """The settings as the text of a file, without its comments."""
    return "\n".join(
        f"[{section}]\n" + "".join(f"{key} = {_toml(value)}\n" for key, value in keys.items())
        for section, keys in table_from(config).items()
    )


def _toml(value: Any) -> str:
    """A text, number, truth value, or a list of these."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def read_key(path: str) -> bytes | None:
    """The planner link's key, from a file that its owner alone may read; None for "".

    Raises:
        ConfigError: the file can't be read, holds no key, or others may read it.
    """
    if not path:
        return None
    try:
        with Path(path).open("rb") as file:
            mode, content = stat.S_IMODE(os.fstat(file.fileno()).st_mode), file.read(4096)
    except OSError as error:
        raise ConfigError(f"planner.key_file: can't read {path!r}: {error.strerror}") from None
    if mode & OTHERS:
        raise ConfigError(
            f"planner.key_file: only its owner may have access to {path!r}, its mode is "
            f"{mode:04o}: chmod 600 {path}"
        )
    return key_from_bytes(content, path)


def key_from_bytes(content: bytes, path: str) -> bytes:
    """From 32 bytes or 64 hex digits; ConfigError where it is neither."""
    text = content.decode("ascii", "replace").strip()
    with contextlib.suppress(ValueError):
        key = bytes.fromhex(text)
        if len(key) == KEY_BYTES:
            return key
        raise ConfigError(
            f"planner.key_file: must hold 64 hex digits, {path!r} holds {2 * len(key)}"
        )
    if len(content) != KEY_BYTES:
        raise ConfigError(
            "planner.key_file: must hold 32 bytes or 64 hex digits, "
            f"{path!r} holds {len(content)} bytes"
        )
    return content
