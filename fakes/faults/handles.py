"""What can be set about a fake or its wire by name: its plain public attributes and its events.

An attribute's kind comes from its annotation or its value, its meaning from the comment that stands
beside it in the class. An event is a public method that takes the time, or nothing, and gives None.
"""

import ast
import functools
import inspect
import re
import textwrap
import typing
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

NO_FAULTS = {  # readings of wires and fakes, and what belongs to the wire alone
    *("clients", "turned_away", "lost", "sent", "news", "path", "host", "port", "swallowed"),
    *("exchange", "step", "feed_datagram", "poll", "reconnected", "connect", "close", "left"),
    *("send", "heard", "sample", "heat", "feed"),
}
ON, OFF = ("on", "true", "yes", "1"), ("off", "false", "no", "0")
UNITS = {"ms": 1e-3, "s": 1.0, "m": 60.0, "": 1.0}


class FaultError(ValueError):
    """A fault that cannot be set: what was given and what is allowed."""


def seconds_from_text(text: str) -> float:
    """A time as a person writes it: 5s, 250ms, 1m; a bare number is seconds.

    >>> [seconds_from_text(text) for text in ("5s", "250ms", "1.5m", "2")]
    [5.0, 0.25, 90.0, 2.0]

    Raises:
        FaultError: anything else.
    """
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)(ms|s|m|)", text)
    if found is None:
        raise FaultError(f"{text!r} is no time; times are like 5s, 250ms, 1m")
    return float(found[1]) * UNITS[found[2]]


@dataclass(frozen=True, slots=True, eq=False)
class Attribute:
    """One plain attribute of a fake or a wire."""

    owner: object
    name: str
    annotation: str
    meaning: str

    @property
    def now(self) -> Any:
        return getattr(self.owner, self.name)

    @property
    def choices(self) -> tuple[str, ...]:
        """The words that it may be; none: no list is known."""
        found = re.search(r"Literal\[(.*?)\]", self.annotation)
        return tuple(re.findall(r"[\"']([^\"']*)[\"']", found[1])) if found else ()

    @property
    def kind(self) -> str:
        now = self.now
        if self.choices:
            return "|".join(self.choices)
        if isinstance(now, bool):
            return "on|off"
        if isinstance(now, tuple | np.ndarray):
            return f"{len(now)} numbers"
        if isinstance(now, dict):
            return f"{self.name}.KEY=VALUE"
        if isinstance(now, set):
            return "a,b,c"
        return {int: "integer", float: "number", str: "text"}.get(type(now), self.annotation)

    def key(self, text: str) -> Any:
        """A key as the dictionary has it; ValueError if it can be none."""
        sort = re.search(r"dict\[(\w+)", self.annotation)
        return _scalar(sort[1] if sort else _kind_of_first(self.now), text)

    def line(self) -> str:
        return f"{self.kind:<22} now {self.now!r:<16} {self.meaning}".rstrip()

    def value(self, key: str | None, text: str | None) -> Any:
        """What it is to be set to.

        Args:
            key: of an entry, where it is a dictionary.

        Raises:
            FaultError: not a value for it.
        """
        now = self.now
        try:
            if (key is not None) != isinstance(now, dict):
                raise ValueError
            if isinstance(now, dict):
                assert key is not None
                sort = re.search(r"dict\[\w+, *(\w+)", self.annotation)
                kind = sort[1] if sort else _kind_of_first(now.values())
                return now | {self.key(key): _scalar(kind, text)}
            if isinstance(now, set):
                kind = "int" if "int" in self.annotation else "str"
                return {_scalar(kind, part) for part in (text or "").split(",")}
            if isinstance(now, tuple | np.ndarray):
                return _numbers(now, text)
            if self.choices:
                if text not in self.choices:
                    raise ValueError
                return text
            kind = self.annotation.split(" ")[0] if now is None else type(now).__name__
            return _scalar(kind, text)
        except ValueError:
            given = "nothing" if text is None else repr(text)
            raise FaultError(f"{self.name}: takes {self.kind}, given {given}") from None


class Event:
    """Something that a fake can be made to do, at once."""

    def __init__(self, owner: object, name: str) -> None:
        self.name = name
        self._method: Callable[..., object] = getattr(owner, name)
        parameters = inspect.signature(self._method).parameters
        self._takes_time = "now_s" in parameters
        self._options = [n for n, p in parameters.items() if p.kind is p.KEYWORD_ONLY]
        self._numbers = [
            n for n, p in parameters.items() if n != "now_s" and p.kind is not p.KEYWORD_ONLY
        ]

    def line(self) -> str:
        takes = ",".join([*self._numbers, *(f"[{option}]" for option in self._options)])
        meaning = (inspect.getdoc(self._method) or "").split("\n")[0]
        return f"{('event ' + takes).strip():<22} {'':<20} {meaning}".rstrip()

    def call_with(self, text: str | None) -> Callable[[float], None]:
        """What to call, with the time.

        Raises:
            FaultError: not what it takes.
        """
        parts = [part for part in (text or "").split(",") if part]
        options = {part: True for part in parts if part in self._options}
        try:
            numbers = [_scalar("int", part) for part in parts if part not in options]
        except ValueError:
            numbers = []
        if len(numbers) != len(self._numbers) or len(numbers) + len(options) != len(parts):
            takes = ",".join([*self._numbers, *self._options]) or "nothing"
            raise FaultError(f"{self.name}: takes {takes}, given {text or 'nothing'}")

        def call(now_s: float) -> None:
            times = (now_s,) if self._takes_time else ()
            self._method(*times, *numbers, **options)

        return call


Handle = Attribute | Event


def handles(*owners: object) -> dict[str, Handle]:
    """All that can be set or called of a fake and its wire, by name; a name that both have is the
    fake's, and the wire's with `wire.` in front."""
    found: dict[str, Handle] = {}
    for owner in owners:
        for name, handle in _handles_of(owner):
            found[f"wire.{name}" if name in found else name] = handle
    return found


def _handles_of(owner: object) -> typing.Iterator[tuple[str, Handle]]:
    notes = _notes(type(owner))  # type: ignore[arg-type]  # classes are hashable
    for name in vars(owner):
        if not name.startswith("_") and name not in NO_FAULTS:
            annotation, meaning = notes.get(name, ("", ""))
            attribute = Attribute(owner, name, annotation, meaning)
            if _is_plain(attribute.now, annotation):
                yield name, attribute
    for name, member in inspect.getmembers(type(owner)):
        if name.startswith("_") or name in NO_FAULTS:
            continue
        if isinstance(member, property) and member.fset is not None:
            annotation = _property_annotation(member)
            meaning = (inspect.getdoc(member) or "").split("\n")[0]
            if _is_plain(getattr(owner, name), annotation):
                yield name, Attribute(owner, name, annotation, meaning)
        elif inspect.isfunction(member) and _is_event(member):
            yield name, Event(owner, name)


def _is_plain(value: object, annotation: str) -> bool:
    if value is None:
        return bool(re.match(r"(bool|int|float|str)\b", annotation))
    if isinstance(value, tuple):
        return bool(value) and all(isinstance(part, int | float) for part in value)
    if isinstance(value, np.ndarray):
        return value.ndim == 1
    if isinstance(value, dict):
        return all(isinstance(part, bool | int | float | str) for part in value.values())
    return isinstance(value, bool | int | float | str | set)


def _is_event(method: Callable[..., object]) -> bool:
    signature = inspect.signature(method)
    optional = (inspect.Parameter.KEYWORD_ONLY,)
    plain = [p for p in list(signature.parameters.values())[1:] if p.kind not in optional]
    known = all(p.name == "now_s" or p.annotation in (int, "int") for p in plain)
    return signature.return_annotation in (None, "None") and known


def _property_annotation(member: property) -> str:
    try:
        hint = typing.get_type_hints(member.fget).get("return", "")
    except NameError:
        return ""
    return str(hint)


@functools.cache
def _notes(sort: type) -> Mapping[str, tuple[str, str]]:
    """Attribute -> (annotation, comment), as they stand in the classes' own text."""
    notes: dict[str, tuple[str, str]] = {}
    for ancestor in reversed(sort.__mro__[:-1]):
        with_source = inspect.getsourcefile(ancestor) is not None
        text = textwrap.dedent(inspect.getsource(ancestor)) if with_source else ""
        lines = text.splitlines()
        aliases = vars(inspect.getmodule(ancestor) or object)
        tree = ast.parse(text)
        fields = [node for top in tree.body if isinstance(top, ast.ClassDef) for node in top.body]
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign | ast.AnnAssign):
                comment = lines[(node.end_lineno or node.lineno) - 1][node.end_col_offset or 0 :]
                meaning = comment.strip().removeprefix("#").strip() if "#" in comment else ""
                annotation = ast.unparse(node.annotation) if hasattr(node, "annotation") else ""
                if annotation in aliases:
                    annotation = str(aliases[annotation])
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                for target in targets:
                    name = target.attr if isinstance(target, ast.Attribute) else None
                    if isinstance(target, ast.Name) and node in fields:
                        name = target.id
                    if name is not None:
                        notes.setdefault(name, (annotation, meaning))
    return notes


def _kind_of_first(values: Iterable[object]) -> str:
    return type(next(iter(values), "")).__name__


def _scalar(kind: str, text: str | None) -> Any:
    """Text to a value of a kind; ValueError if it is none."""
    if kind == "bool":
        if text is None or text.lower() in ON:
            return True
        if text.lower() in OFF:
            return False
        raise ValueError
    if text is None:
        raise ValueError
    if kind == "int":
        return int(text, 0)
    if kind == "float":
        try:
            return float(text)
        except ValueError:
            return seconds_from_text(text)
    return text


def _numbers(now: Any, text: str | None) -> Any:
    parts = (text or "").split(",")
    if len(parts) != len(now):
        raise ValueError
    kind = "float" if isinstance(now, np.ndarray) else type(now[0]).__name__
    values = [_scalar(kind, part) for part in parts]
    return np.array(values) if isinstance(now, np.ndarray) else tuple(values)
