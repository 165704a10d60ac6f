"""What a Roboteq AX3500 says of itself, and driving by keyboard.

`info` and `watch` read the controller on its own port; they move no motor and change nothing. Close
mapod first: a port has one reader. A controller in R/C mode only logs; it is left in that mode.
`keys` asks mapod, over its planner link, to move the robot while keys are held.
"""

import sys
from collections.abc import Callable

from core.config import ConfigError
from hw.ax3500.lines import (
    CR,
    ENCODER_BIT,
    READ_COUNTER,
    READ_IDENTITY,
    Line,
    LineParser,
    battery_v_from_byte,
    celsius_from_thermistor,
    encode_query,
    internal_v_from_byte,
    maybe_byte,
    maybe_counter,
)
from hw.ax3500.values import READ_STATUS, STATUS_BITS
from hw.ports.wires import PortUrlError
from tools.cli import view
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError, conversation
from tools.cli.options import Parser, add_actions, add_seconds, configured, fail, parser_of

ANSWER_S, LISTEN_S, TRIES = 0.4, 0.6, 2
LINES = {"?E": 2, "?M": 2, "?I": 3}  # of an answer; all others have one
MODES = {0: "R/C", 1: "RS-232 without watchdog", 2: "RS-232 with watchdog", 3: "analog"}
NEEDS_WATCHDOG = "mapod moves no motor with it: set ^00 to 02"
WATCH_S = 1.0


def answer(talk: Conversation, query: str) -> list[str]:
    """The lines after a query's echo; a refusal is the line `-`.

    Raises:
        NoAnswerError: no echo, or no answer.
    """
    wanted = LINES.get(query, 1)
    for _ in range(TRIES):
        talk.say(encode_query(query))
        texts: list[str] = []
        for event in talk.hear(ANSWER_S):
            if not isinstance(event, Line):
                continue
            texts.append(event.text)
            after = texts[texts.index(query) + 1 :] if query in texts else []
            if len(after) == wanted or after == ["-"]:
                return after
    raise NoAnswerError(f"no answer to {query}")


def check_answers(talk: Conversation) -> None:
    """Raises RefusedError for a controller that only logs, NoAnswerError for one that is silent."""
    for event in talk.hear(LISTEN_S):
        if isinstance(event, Line) and event.text.startswith(":"):
            raise RefusedError("the controller is in R/C or analog mode and answers nothing")
    talk.say(CR)
    try:
        answer(talk, READ_IDENTITY)
    except NoAnswerError:
        raise NoAnswerError("no answer: check power, baud=9600, parity=E and bytesize=7") from None


def numbers(talk: Conversation, query: str) -> list[int] | None:
    """The bytes that answer a query; None where it is refused or damaged."""
    values = [maybe_byte(text) for text in answer(talk, query)]
    known = [value for value in values if value is not None]
    return known if len(known) == LINES.get(query, 1) else None


def identity(talk: Conversation) -> str:
    """The model's bits."""
    bits = (numbers(talk, READ_IDENTITY) or [0])[0]
    return f"identity {bits:02X}, {'with' if bits & ENCODER_BIT else 'WITHOUT'} encoder module"


def mode(talk: Conversation) -> str:
    """How it starts."""
    found = (numbers(talk, "^00") or [-1])[0]
    doubt = "" if found == 2 else f"; {NEEDS_WATCHDOG}"
    return f"mode {MODES.get(found, 'not told')}{doubt}"


def status(talk: Conversation) -> str:
    """What keeps the motors off."""
    found = numbers(talk, READ_STATUS)
    if found is None:
        return "status not told"
    words = [STATUS_BITS.get(k, f"bit {k}") for k in range(8) if found[0] >> k & 1]
    return f"status {', '.join(words) or 'all well'}"


def stop_button(talk: Conversation) -> str:
    """The emergency stop's input."""
    found = numbers(talk, "?I")
    if found is None:
        return "emergency stop not told"
    return f"emergency stop {'PRESSED' if found[2] == 0 else 'not pressed'}"


def volts(talk: Conversation) -> str:
    """Battery and internal supply."""
    found = numbers(talk, "?E")
    if found is None:
        return "voltages not told"
    battery_v, internal_v = battery_v_from_byte(found[0]), internal_v_from_byte(found[1])
    return f"battery {battery_v:.1f} V, internal supply {internal_v:.1f} V"


def heat(talk: Conversation) -> str:
    """The heat sinks."""
    found = numbers(talk, "?M")
    if found is None:
        return "temperatures not told"
    return "heat sinks " + " and ".join(f"{celsius_from_thermistor(n):.0f} C" for n in found)


def counters(talk: Conversation) -> str:
    """Both encoder counters."""
    counts = [maybe_counter(answer(talk, query)[0]) for query in READ_COUNTER]
    told = ["not readable" if count is None else str(count) for count in counts]
    return f"counters {told[0]} and {told[1]}"


INFO: tuple[Callable[[Conversation], str], ...] = (
    identity, mode, status, stop_button, volts, heat, counters,
)  # fmt: skip
WATCHED: tuple[Callable[[Conversation], str], ...] = (counters, volts, status)


def watch(talk: Conversation, seconds: float | None) -> None:
    """A line a second, for so long or until Ctrl-C."""
    begun_s = talk.now_s()
    while True:
        print("; ".join(told(talk) for told in WATCHED), flush=True)
        if seconds is not None and talk.now_s() - begun_s + WATCH_S > seconds:
            return
        list(talk.hear(WATCH_S))


def parser() -> Parser:
    """The command line."""
    words = parser_of(
        "drive", __doc__, "mapod drive info", "mapod drive keys --port udp://127.0.0.1:9750"
    )
    action = add_actions(words, "'serial:///dev/ax3500?baud=9600&parity=E&bytesize=7'")
    action("info", "who it is and how it is")
    add_seconds(action("watch", "a line each second"), "until Ctrl-C")
    action("keys", "drive by keyboard, over a planner link: the options are those of mapod view")
    return words


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused or silent, 2 wrong use."""
    arguments = list(sys.argv[1:] if given is None else given)
    if arguments[:1] == ["keys"]:
        return view.main([*arguments[1:], "--drive"])
    options = parser().parse_args(arguments)
    try:
        url = options.port or configured(options.config).drive.port
        with conversation(url, LineParser()) as talk:
            check_answers(talk)
            if options.what == "watch":
                watch(talk, options.seconds)
            else:
                print(*(told(talk) for told in INFO), sep="\n")
    except (ConfigError, PortUrlError, OSError) as error:
        return fail("drive", error)
    except (NoAnswerError, RefusedError) as error:
        return fail("drive", error, 1)
    return 0


if __name__ == "__main__":
    sys.exit(main())
