"""An older settings file with the keys that are new added, each at its shipped value.

The robot's own lines stay as they are, to the byte. What the new version does not know, or what is
out of range, is refused by the settings' own check.
"""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from config_file import load_config
from core.config import ConfigError
from core.device_settings import Ahrs, Drive, Scanner

HEAD = re.compile(r"\s*\[\s*(\w+)\s*\]")
ENTRY = re.compile(r"(\w+)\s*=")
DEVICES = {"scanner": Scanner, "ahrs": Ahrs, "drive": Drive}


@dataclass(frozen=True, slots=True)
class Merged:
    """A settings file, and what was added to it: `[map] cells = 101`, each with its comment."""

    text: str
    added: list[str]


def merged(old: str, shipped: str) -> Merged:
    """An older file with what it lacks of the shipped one. Raises ConfigError: it can't be used."""
    has = _table(old)
    lines, added = old.splitlines(keepends=True), []
    newline = "\r\n" if lines and lines[0].endswith("\r\n") else "\n"
    if lines and not lines[-1].endswith("\n"):
        lines[-1] += newline
    wanted = {
        section: dict(keys) if isinstance(keys, dict) else keys for section, keys in has.items()
    }
    for section, key, value, text in _missing(has, shipped):
        wanted.setdefault(section, {})[key] = value
        added.append(f"[{section}] {text[0].partition('#')[0].rstrip()}")
        _insert(lines, section, [line.rstrip("\n") + newline for line in text], newline)
    result = "".join(lines) if added else old
    if not _says(result, wanted):
        raise ConfigError(f"add by hand: {', '.join(added)}: there is no [section] line for it")
    load_config(result)
    return Merged(result, added)


def _table(text: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"not valid TOML: {error}") from None


def _says(text: str, wanted: dict[str, Any]) -> bool:
    """Whether the lines came to stand where they mean what they should."""
    try:
        return tomllib.loads(text) == wanted
    except tomllib.TOMLDecodeError:
        return False


def _missing(has: dict[str, Any], shipped: str) -> Iterator[tuple[str, str, Any, list[str]]]:
    """Section, key, value and lines of what the shipped file has and the other has not.

    A device of another driver gets the keys of all drivers only: others' mean nothing to it.
    """
    values = tomllib.loads(shipped)
    for section, key, text in _entries(shipped):
        given = has.get(section, {})
        if not isinstance(given, dict) or key in given:
            continue
        is_other = given.get("driver") not in (None, values[section].get("driver"))
        if section in DEVICES and is_other and key not in DEVICES[section].__struct_fields__:
            continue
        yield section, key, values[section][key], text


def _entries(text: str) -> Iterator[tuple[str, str, list[str]]]:
    """Each key of the shipped file with its lines: comments that go on are its own."""
    section, found = "", list[tuple[str, str, list[str]]]()
    for line in text.splitlines(keepends=True):
        if head := HEAD.match(line):
            section = head[1]
        elif entry := ENTRY.match(line):
            found.append((section, entry[1], [line]))
        elif line.startswith(" ") and line.lstrip().startswith("#") and found:
            found[-1][2].append(line)
    yield from found


def _insert(lines: list[str], section: str, text: list[str], newline: str) -> None:
    """Behind the last line of a section that says something; a new section comes last."""
    inside, at = False, None
    for i, line in enumerate(lines):
        if head := HEAD.match(line):
            inside = head[1] == section
        if inside and line.strip():
            at = i + 1
    if at is None:
        lines += [newline, f"[{section}]{newline}"]
        at = len(lines)
    lines[at:at] = text
