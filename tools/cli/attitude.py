"""What a person may want of an MTi beside measuring.

Filter profiles (scenarios), heading and object reset, self test, gyroscope bias, baud rate. The
port is that of mapod.toml, or --port. Close mapod first: a port has one reader. The device measures
again when this is done.
"""

import struct
from collections.abc import Callable, Iterator

from hw.mti.frames import (
    BAUD_CODES,
    Mid,
    MtFrame,
    MtParser,
    describe_error,
    encode_frame,
    maybe_configuration,
)
from hw.ports.url import parse_url
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError, print_what
from tools.cli.options import Parser, parser_of, value_of, whole_in

DEFAULT_BAUD = 115_200
CONFIG_S, CONFIG_TRIES = 0.25, 20  # acknowledgements get lost among the data in the pipe
SELF_TEST_S = 4.0  # the answer takes up to 3 s
SCENARIO_BYTES = 22  # of one in the list
SELF_TESTS = [  # by bit
    f"{what} {axis}"
    for what in ("acceleration", "rate of turn", "magnetic field")
    for axis in ("x", "y", "z")
]
STORE = 0  # what the resets before it have made; Config state
RESETS = {  # Measurement state
    "heading-reset": 1,
    "object-reset": 3,
    "alignment-reset": 4,
    "default-heading": 5,
    "default-object": 6,
    "default-alignment": 7,
}


def answer(
    talk: Conversation, mid: Mid, data: bytes = b"", seconds: float = 1.0, tries: int = 3
) -> bytes:
    """Data of the answer. Raises NoAnswerError, RefusedError: none came, or an Error."""

    def is_answer(event: MtFrame) -> bool:
        return event.mid in (mid + 1, Mid.Error)

    frame: MtFrame = talk.ask(encode_frame(mid, data), is_answer, seconds, tries)
    if frame.mid == Mid.Error:
        raise RefusedError(f"the MTi refuses {mid.name}: {describe_error(frame.data)}")
    return frame.data


def mt_parser(url: str) -> MtParser:
    return MtParser(parse_url(url).baud or DEFAULT_BAUD)


def to_config(talk: Conversation) -> None:
    """Stop measuring, however much data comes first."""
    answer(talk, Mid.GoToConfig, b"", CONFIG_S, CONFIG_TRIES)


def to_measurement(talk: Conversation) -> None:
    """Measure again; data proves it as well as the answer that it may hide."""
    talk.ask(encode_frame(Mid.GoToMeasurement), lambda event: event.mid != Mid.Error, CONFIG_S)


def info(talk: Conversation) -> list[str]:
    to_config(talk)
    lines = [f"device id {answer(talk, Mid.ReqDID).hex()}"]
    try:
        product = answer(talk, Mid.ReqProductCode)
        lines.append(f"product {product.decode('ascii', 'replace').strip()}")
    except (RefusedError, NoAnswerError):
        lines.append("product not told")
    configuration = maybe_configuration(answer(talk, Mid.ReqConfiguration))
    if configuration is not None:
        firmware = ".".join(str(part) for part in configuration.firmware)
        lines += [
            f"firmware {firmware}, {configuration.rate_hz:g} messages a second",
            f"output mode {configuration.output_mode:04X}, "
            f"settings {configuration.output_settings:08X}",
        ]
    return lines + scenarios(talk)


def scenarios(talk: Conversation) -> list[str]:
    to_config(talk)
    lines = [f"scenario {kind}: {name} (version {n})" for kind, n, name in _offered(talk)]
    current = answer(talk, Mid.SetScenario)  # version and kind
    return [*lines, f"in use: {current[1]}" if len(current) == 2 else "in use: not told"]


def _offered(talk: Conversation) -> list[tuple[int, int, str]]:
    data = answer(talk, Mid.ReqAvailableScenarios)
    ends = range(SCENARIO_BYTES, len(data) + 1, SCENARIO_BYTES)
    entries = [data[end - SCENARIO_BYTES : end] for end in ends]
    return [
        (entry[0], entry[1], entry[2:].decode("ascii", "replace").strip("\0 "))
        for entry in entries
        if entry[0]  # else an empty place
    ]


def set_scenario(talk: Conversation, kind: int) -> list[str]:
    to_config(talk)
    kinds = [offered for offered, _, _ in _offered(talk)]
    if kind not in kinds:
        raise RefusedError(f"scenario: must be one of {kinds}, is {kind}")
    answer(talk, Mid.SetScenario, struct.pack(">H", kind))
    return scenarios(talk)


def reset_orientation(talk: Conversation, name: str, keep: bool) -> list[str]:
    """Reset while it measures; kept over a loss of power only if told so."""
    to_measurement(talk)
    answer(talk, Mid.ResetOrientation, struct.pack(">H", RESETS[name]))
    if not keep:
        return [f"{name} done, until the next loss of power (--keep to store it)"]
    to_config(talk)
    answer(talk, Mid.ResetOrientation, struct.pack(">H", STORE))
    return [f"{name} done and stored"]


def self_test(talk: Conversation) -> list[str]:
    to_config(talk)
    data = answer(talk, Mid.RunSelfTest, b"", SELF_TEST_S, 1)
    if len(data) != 2:
        raise RefusedError("the MTi's answer to RunSelfTest is not one")
    passed = int.from_bytes(data, "big")
    failed = [sensor for bit, sensor in enumerate(SELF_TESTS) if not passed >> bit & 1]
    return [f"failed: {', '.join(failed)}"] if failed else ["all passed"]


def keep_still(talk: Conversation, seconds: int) -> list[str]:
    to_measurement(talk)
    answer(talk, Mid.SetNoRotation, struct.pack(">H", seconds))
    return [f"keep it still for {seconds} s: it learns the bias of its gyroscopes"]


def set_baud(talk: Conversation, baud: int) -> list[str]:
    to_config(talk)
    answer(talk, Mid.SetBaudrate, bytes([BAUD_CODES[baud]]))
    return [f"{baud} baud from its next power-up on: set it in mapod.toml then"]


def a_baud(text: str) -> int:
    return value_of(text, int, BAUD_CODES.__contains__, f"one of {sorted(BAUD_CODES)}")


def parser() -> Parser:
    words = parser_of("attitude", __doc__, "mapod attitude info", "mapod attitude scenario 3")
    action = words.add_actions("'serial:///dev/ttyUSB0?baud=115200'")
    action("info", "who it is and how it is set")
    action("scenarios", "the filter profiles it offers")
    action("scenario", "choose one").add_argument("kind", type=whole_in(0, 0xFFFF))
    for name in RESETS:
        reset = action(name, "while it measures")
        reset.add_argument("--keep", action="store_true", help="over a loss of power, too")
    action("self-test", "of each sensor axis")
    action("still", "learn the gyroscopes' bias").add_argument("seconds", type=whole_in(0, 0xFFFF))
    baud = action("baud", "from its next power-up on")
    baud.add_argument("baud", type=a_baud)
    return words


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused or silent, 2 wrong use."""
    options = parser().parse_args(given)
    does: dict[str, Callable[[Conversation], list[str]]] = {
        "info": info,
        "scenarios": scenarios,
        "scenario": lambda talk: set_scenario(talk, options.kind),
        "self-test": self_test,
        "still": lambda talk: keep_still(talk, options.seconds),
        "baud": lambda talk: set_baud(talk, options.baud),
    }
    act = does.get(options.what) or (
        lambda talk: reset_orientation(talk, options.what, options.keep)
    )

    def act_and_measure(talk: Conversation) -> Iterator[str]:
        yield from act(talk)
        to_measurement(talk)

    return print_what(act_and_measure, "attitude", "ahrs", options, mt_parser)
