"""The output configuration of a newer MTi: what is taken, when each packet is due, what it costs.

Source: MTi sheet, sections 3 and 5.
"""

import math
import struct

from fakes.mti.memory import BAD_PARAMETER, TOO_MUCH_DATA
from fakes.mti.models import FOURTH, Model
from fakes.mti.packets import HEADERS, ORIENTED, SIZES, kind_of, packet_size

Outputs = tuple[tuple[int, int], ...]
MOST_ENTRIES = 32
MAX_HZ = 0xFFFF
HEADER_HZ = 100  # of messages that hold headers alone
FRAME_BYTES = 5


def maybe_outputs(data: bytes, model: Model) -> Outputs | int:
    """The list with the values taken, or the code of an Error."""
    if len(data) % 4 or len(data) > 4 * MOST_ENTRIES:
        return BAD_PARAMETER
    taken = []
    for identifier, rate_hz in struct.iter_unpack(">HH", data):
        entry = maybe_entry(identifier, rate_hz, model)
        if entry is not None:
            taken.append(entry)
        elif model.refuses_unknown:
            return BAD_PARAMETER
    return tuple(taken)


def maybe_entry(identifier: int, rate_hz: int, model: Model) -> tuple[int, int] | None:
    """One output as it is taken; None: the device has it not."""
    kind = kind_of(identifier)
    if kind in HEADERS:
        return (identifier, MAX_HZ) if identifier == kind else None
    most_hz = model.rates_hz.get(kind)
    if most_hz is None or kind not in SIZES:
        return None
    if identifier & 0xC and (kind not in ORIENTED or identifier & 0xC == 0xC):
        return None
    if rate_hz in (0, MAX_HZ) or rate_hz >= most_hz:
        return identifier, most_hz
    return identifier, max(hz for hz in range(1, rate_hz + 1) if most_hz % hz == 0)


def wire_form(outputs: Outputs) -> bytes:
    """The data of message C1."""
    return b"".join(struct.pack(">HH", *entry) for entry in outputs)


def stride(outputs: Outputs, base_hz: int) -> int:
    """The base ticks from one instant to the next at which anything is due; 0: never."""
    rates = [hz for identifier, hz in outputs if is_rated(identifier)]
    if not rates:
        headers_only = any(kind_of(identifier) in HEADERS for identifier, _ in outputs)
        return base_hz // HEADER_HZ if headers_only else 0
    return math.gcd(*(base_hz // hz for hz in rates))


def is_rated(identifier: int) -> bool:
    """Whether it comes at a rate of its own: no header."""
    return kind_of(identifier) not in HEADERS


def due(outputs: Outputs, tick: int, base_hz: int) -> list[int]:
    """The identifiers, in the order of the list, whose time is a base tick; headers if any is."""
    rated = {i for i, hz in outputs if is_rated(i) and tick % (base_hz // hz) == 0}
    headers_alone = not any(is_rated(identifier) for identifier, _ in outputs)
    if not rated and not headers_alone:
        return []
    return [i for i, _ in outputs if i in rated or kind_of(i) in HEADERS]


def bytes_per_s(outputs: Outputs, base_hz: int) -> float:
    """What the line must carry."""
    step = stride(outputs, base_hz)
    messages_hz = base_hz / step if step else 0.0
    headers = sum(3 + packet_size(i) for i, _ in outputs if kind_of(i) in HEADERS)
    rated = sum((3 + packet_size(i)) * hz for i, hz in outputs if kind_of(i) not in HEADERS)
    return messages_hz * (headers + FRAME_BYTES) + rated


def check_fits(outputs: Outputs, model: Model, baud: int) -> int:
    """0, or the Error of a list that the line cannot carry."""
    return TOO_MUCH_DATA if bytes_per_s(outputs, model.base_hz) * 10 > baud else 0


def speaks_legacy(data: bytes, model: Model) -> bool:
    """Whether a list means: legacy MTData from now on; the fourth generation only."""
    return data == bytes(4) and model.generation == FOURTH
