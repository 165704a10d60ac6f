"""Finds out which MTi it is and sets what it needs; reads back what it took.

Settings wear the device's memory, so only what differs is set. Legacy devices (MTData) know
SetOutputMode, newer ones (MTData2) SetOutputConfiguration: the device id tells which to try first,
the answers decide.
Source: MTi sheet, sections 3, 8 and 9.
"""

import struct

from hw.exchange import StartAgainError, Steps
from hw.mti.conversation import NO_ANSWER, OPTIONAL_TRIES, TRIES, Conversation
from hw.mti.frames import (
    CONFIGURATION_BYTES,
    NOT_IMPLEMENTED,
    TIMER_OVERFLOW,
    TOO_MUCH_OUTPUT,
    Mid,
    maybe_configuration,
)
from hw.mti.mtdata import IN_NED, ORIENTATIONS, MtDataDecoder
from hw.mti.output import (
    ALWAYS,
    FINE_TIME,
    NAMES,
    PACKET_COUNTER,
    RATE_OF_TURN,
    TICKS_PER_S,
    NewOutput,
    legacy_output,
    new_outputs,
)
from hw.mti.stream import MtStream

LEGACY_TYPES = (0x3, 0x5)  # bits 00F00000 of the device id: MTi and MTx, MTi-G
SLOWER_HZ = (400, 256, 200, 120, 100, 50)  # to fall back to; 120 is what the makers promise
TOO_MUCH = (TIMER_OVERFLOW, 0x23, 0x24, TOO_MUCH_OUTPUT)
OUTPUT_SIZES = tuple(range(0, 129, 4))  # bytes of an output configuration


def identify(talk: Conversation, stream: MtStream) -> Steps[None]:
    """Who it is; only the id is insisted on."""
    stream.device_id = (yield from talk.ask(Mid.ReqDID, b"", 4, 8)).hex()
    product = yield from talk.try_ask(Mid.ReqProductCode, b"", *range(1, 21))
    if isinstance(product, bytes):
        stream.product = product.decode("ascii", "replace").strip("\0 ")
    firmware = yield from talk.try_ask(Mid.ReqFWRev, b"", 3, 11)
    if isinstance(firmware, bytes):
        stream.firmware = ".".join(str(part) for part in firmware[:3])
    if not _seems_legacy(stream.device_id):
        hardware = yield from talk.try_ask(Mid.ReqHardwareVersion, b"", 2, tries=1)
        if isinstance(hardware, bytes):
            stream.hardware = f"{hardware[0]}.{hardware[1]}"
    yield from talk.try_ask(Mid.ReqConfiguration, b"", CONFIGURATION_BYTES)


def _seems_legacy(device_id: str) -> bool:
    """By its id of 4 bytes (600 series: 8); the answers to requests decide."""
    return len(device_id) == 8 and int(device_id, 16) >> 20 & 0xF in LEGACY_TYPES


def set_up(talk: Conversation, stream: MtStream, rate_hz: float, baud: int) -> Steps[None]:
    """Output and rate, by whichever messages the device knows."""
    probes = [(Mid.SetOutputMode, (2,)), (Mid.SetOutputConfiguration, OUTPUT_SIZES)]
    for mid, sizes in probes if _seems_legacy(stream.device_id) else probes[::-1]:
        answer = yield from talk.try_ask(mid, b"", *sizes)
        if answer in (NOT_IMPLEMENTED, NO_ANSWER):
            continue
        if mid == Mid.SetOutputConfiguration:  # an Error may come in reply to reading, too
            held = _outputs(answer) if isinstance(answer, bytes) else []
            yield from _set_up_new(talk, stream, held, new_outputs(rate_hz, baud))
        elif isinstance(answer, int):
            raise StartAgainError(talk.describe_refusal(mid, answer))
        else:
            yield from _set_up_legacy(talk, stream, rate_hz, baud)
        return
    raise StartAgainError("the MTi knows neither SetOutputMode nor SetOutputConfiguration")


def _set_up_legacy(talk: Conversation, stream: MtStream, rate_hz: float, baud: int) -> Steps[None]:
    """Mode, settings and period; a shorter period of another host goes first: it may overflow."""
    wanted = legacy_output(rate_hz, baud)
    stream.note(wanted.remark)
    period = yield from talk.read(Mid.SetPeriod, 2)
    if period < wanted.period:
        period = yield from _set_period(talk, stream, period, wanted.period)
    mode = yield from _set(talk, Mid.SetOutputMode, 2, wanted.mode)
    settings = yield from _set(talk, Mid.SetOutputSettings, 4, wanted.settings)
    if (mode, settings & ~IN_NED) != (wanted.mode, wanted.settings):
        raise StartAgainError(
            f"the MTi has output mode {mode:04X} and settings {settings:08X}, "
            f"not {wanted.mode:04X} and {wanted.settings:08X} as it was told"
        )
    if period > wanted.period:
        period = yield from _set_period(talk, stream, period, wanted.period)
    period *= 1 + (yield from _clear_skip_factor(talk))
    given_hz = TICKS_PER_S / max(period, 1)
    if abs(given_hz - rate_hz) > 0.01 * rate_hz:
        stream.note(f"the MTi gives {given_hz:.1f} samples a second, not {rate_hz:g} as configured")
    answer = yield from talk.try_ask(Mid.ReqConfiguration, b"", CONFIGURATION_BYTES)
    held = maybe_configuration(answer) if isinstance(answer, bytes) else None
    if held is not None and (held.output_mode, held.output_settings) != (mode, settings):
        stream.note("the MTi's configuration block contradicts its settings")
    stream.legacy = MtDataDecoder(mode, settings)
    stream.with_rate = "rate_radps" in stream.legacy
    stream.period_s = max(period, 1) / TICKS_PER_S


def _set(talk: Conversation, mid: Mid, size: int, wanted: int) -> Steps[int]:
    held = yield from talk.read(mid, size)
    if held & ~IN_NED == wanted:
        return held
    yield from talk.ask(mid, wanted.to_bytes(size, "big"))
    return (yield from talk.read(mid, size))


def _set_period(talk: Conversation, stream: MtStream, held: int, wanted: int) -> Steps[int]:
    """The period in the end; one that is refused gives way to longer ones, then to the old one."""
    longer = [TICKS_PER_S // hz for hz in SLOWER_HZ if TICKS_PER_S // hz > wanted]
    for period in [wanted, *longer]:
        if period == held:
            return held
        answer = yield from talk.try_ask(Mid.SetPeriod, period.to_bytes(2, "big"))
        if answer == NO_ANSWER:
            raise StartAgainError(talk.describe_refusal(Mid.SetPeriod, NO_ANSWER))
        if isinstance(answer, bytes):
            return (yield from talk.read(Mid.SetPeriod, 2))
        stream.note(talk.describe_refusal(Mid.SetPeriod, answer))
    return held


def _clear_skip_factor(talk: Conversation) -> Steps[int]:
    """Samples left out after each one, in the end; some devices do not know the message."""
    skip = yield from talk.try_ask(Mid.SetOutputSkipFactor, b"", 2)
    if not isinstance(skip, bytes) or skip == b"\0\0":
        return 0
    yield from talk.ask(Mid.SetOutputSkipFactor, b"\0\0")
    left = yield from talk.read(Mid.SetOutputSkipFactor, 2)
    if left == 0xFFFF:
        raise StartAgainError("the MTi sends only on request: it keeps skip factor FFFF")
    return left


def _set_up_new(
    talk: Conversation, stream: MtStream, held: list[tuple[int, int]], choices: list[NewOutput]
) -> Steps[None]:
    """The first choice that the device takes; its answer carries what it made of it."""
    for choice in choices:
        if sorted(held) == sorted(choice.outputs):
            _note_outputs(stream, choice, held)
            return
        data = b"".join(struct.pack(">HH", *output) for output in choice.outputs)
        is_last = choice is choices[-1]
        answer = yield from talk.try_ask(
            Mid.SetOutputConfiguration,
            data,
            *OUTPUT_SIZES,
            tries=TRIES if is_last else OPTIONAL_TRIES,
        )
        if isinstance(answer, bytes):
            taken = yield from talk.ask(Mid.SetOutputConfiguration, b"", *OUTPUT_SIZES)
            _note_outputs(stream, choice, _outputs(taken))
            return
        refusal = talk.describe_refusal(Mid.SetOutputConfiguration, answer)
        if is_last or answer not in TOO_MUCH:
            raise StartAgainError(refusal)
        stream.note(refusal)


def _outputs(data: bytes) -> list[tuple[int, int]]:
    """Identifier and Hz of each, in the device's order; 65535 Hz: with every message."""
    return [(identifier, rate_hz) for identifier, rate_hz in struct.iter_unpack(">HH", data)]


def _note_outputs(stream: MtStream, choice: NewOutput, held: list[tuple[int, int]]) -> None:
    """What the device gives, against what it was asked for; formats and frames may differ."""
    stream.note(choice.remark)
    given = {identifier & 0xFFF0: rate_hz for identifier, rate_hz in held}
    orientation_hz = max((given.get(kind, 0) for kind in ORIENTATIONS), default=0)
    if not orientation_hz:
        missing = next(kind for kind, _ in choice.outputs if kind in ORIENTATIONS)
        raise StartAgainError(f"the MTi does not offer output {NAMES[missing]}")
    for identifier, rate_hz in choice.outputs:
        if identifier not in NAMES:
            continue  # it runs as well without
        output, given_hz = NAMES[identifier], given.get(identifier, 0)
        if not given_hz:
            stream.note(f"the MTi does not offer output {output}")
        elif given_hz not in (rate_hz, ALWAYS):
            stream.note(f"the MTi gives output {output} at {given_hz} Hz, not {rate_hz}")
    if not given.keys() & {PACKET_COUNTER, FINE_TIME}:
        stream.note("the MTi gives neither counter nor time: samples are dated by their arrival")
    stream.legacy = None
    stream.with_rate = RATE_OF_TURN in given
    stream.period_s = 1.0 / (choice.rate_hz if orientation_hz == ALWAYS else orientation_hz)
