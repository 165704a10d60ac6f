"""Faults on a timetable, as a person writes them: `mute@5s`, `delay_s=0.2@5s-7s`, `reboot@10s`.

    NAME[=VALUE]@START[-END|+DURATION]

NAME is an attribute or an event of a fake or of its wire, behind the device's name and a point
where there are several devices, and before a point and a key where it is a dictionary. Times count
from the first step. What ends, ends at the value that was there before.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fakes.faults.handles import Event, FaultError, Handle, handles, seconds_from_text

__all__ = ["FaultError", "Order", "Schedule", "list_of_all", "order_from_text"]

PATTERN = re.compile(r"([^=@]+)(?:=(.*))?@([^@]+)")


@dataclass(frozen=True, slots=True)
class Order:
    """One fault and its time, seconds from the begin; end_s None: it stays."""

    name: str
    value: str | None
    start_s: float
    end_s: float | None


def order_from_text(text: str) -> Order:
    """What a person wrote.

    >>> order_from_text("delay_s=0.2@5s+500ms")
    Order(name='delay_s', value='0.2', start_s=5.0, end_s=5.5)

    Raises:
        FaultError: not of this form.
    """
    found = PATTERN.fullmatch(text.strip())
    if found is None:
        raise FaultError(f"{text!r}: a fault is NAME[=VALUE]@START[-END|+DURATION]")
    name, value, times = found.groups()
    start, sign, rest = re.fullmatch(r"([^-+]*)(?:([-+])(.*))?", times, re.DOTALL).groups()  # type: ignore[union-attr]
    start_s = seconds_from_text(start)
    end_s = None
    if sign:
        end_s = seconds_from_text(rest) + (start_s if sign == "+" else 0.0)
        if end_s <= start_s:
            raise FaultError(f"{text!r}: ends before it begins")
    return Order(name.strip(), value, start_s, end_s)


class Schedule:
    """Sets faults when they are due; the first step is the begin.

    Args:
        orders: in any order.
        targets: device -> the objects that have its attributes; the one device of a program may be
            called "" and then needs no name.

    Raises:
        FaultError: a name or a value that there is not.
    """

    def __init__(self, orders: Sequence[Order], targets: Mapping[str, Sequence[object]]) -> None:
        known = {device: handles(*owners) for device, owners in targets.items()}
        self._due: list[tuple[float, int, Callable[[float], str]]] = []
        self._begin_s: float | None = None
        for order in orders:
            self._plan(order, known)
        self._due.sort(key=lambda due: due[:2])

    def step(self, now_s: float) -> list[str]:
        """Set what is due; what happened, in words."""
        if self._begin_s is None:
            self._begin_s = now_s
        said = []
        while self._due and self._due[0][0] <= now_s - self._begin_s:
            said.append(self._due.pop(0)[2](now_s))
        return said

    def _plan(self, order: Order, known: Mapping[str, Mapping[str, Handle]]) -> None:
        handle, key = _found(order.name, known)
        if isinstance(handle, Event):
            call = handle.call_with(order.value)
            if order.end_s is not None:
                raise FaultError(f"{order.name}: happens at once and has no end")

            def happen(now_s: float) -> str:
                call(now_s)
                return f"{order.name} now"

            self._due.append((order.start_s, len(self._due), happen))
            return
        handle.value(key, order.value)  # wrong ones are found before anything starts
        before: list[Any] = []

        def begin(now_s: float) -> str:
            before.append(handle.now)
            setattr(handle.owner, handle.name, handle.value(key, order.value))
            return f"{order.name} on" if order.value is None else f"{order.name}={order.value} on"

        def end(now_s: float) -> str:
            old = before.pop()
            if key is not None:  # other entries may have changed meanwhile
                changed, now = handle.key(key), dict(handle.now)
                now.pop(changed, None)
                old = now | ({changed: old[changed]} if changed in old else {})
            setattr(handle.owner, handle.name, old)
            return f"{order.name} off"

        self._due.append((order.start_s, len(self._due), begin))
        if order.end_s is not None:
            self._due.append((order.end_s, len(self._due), end))


def _found(name: str, known: Mapping[str, Mapping[str, Handle]]) -> tuple[Handle, str | None]:
    """The handle of a name, and the key where one follows."""
    device, rest = "", name
    if "" not in known:
        device, _, rest = name.partition(".")
        if device not in known:
            devices = ", ".join(known)
            raise FaultError(f"{name!r}: no device {device!r}; write one of {devices}, then a '.'")
    attribute, key = rest, ""
    if rest not in known[device]:
        attribute, _, key = rest.partition(".")
    if attribute not in known[device]:
        allowed = ", ".join(sorted(known[device]))
        raise FaultError(f"{name!r}: no such fault; there are {allowed}")
    return known[device][attribute], key or None


def list_of_all(targets: Mapping[str, Sequence[object]]) -> str:
    lines = []
    for device, owners in targets.items():
        if device:
            lines.append(f"{device}.")
        lines += [f"  {name:<24} {h.line()}" for name, h in sorted(handles(*owners).items())]
    return "\n".join(lines)
