"""What a Roboteq AX3500 says of itself, and driving by keyboard.

`info` and `watch` read the controller on its own port; they move no motor and change nothing. Close
mapod first: a port has one reader. A controller in R/C mode only logs; it is left in that mode.
`keys` asks mapod, over its planner link, to move the robot while keys are held.
"""

import sys
from collections.abc import Iterable, Iterator

from hw.ax3500.lines import (
    CR,
    ENCODER_BIT,
    READ_COUNTER,
    READ_IDENTITY,
    Line,
    LineParser,
    encode_query,
    maybe_byte,
    maybe_counter,
)
from hw.ax3500.values import (
    READ_INPUTS,
    READ_STATUS,
    VALUES,
    ControllerState,
    describe_status,
    state_after_answer,
)
from tools.cli import view
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError, print_what
from tools.cli.options import Parser, parser_of

ANSWER_S, LISTEN_S, TRIES = 0.4, 0.6, 2
MODES = {0: "R/C", 1: "RS-232 without watchdog", 2: "RS-232 with watchdog", 3: "analog"}
NEEDS_WATCHDOG = "mapod moves no motor with it: set ^00 to 02"
WATCH_S = 1.0


def answer(talk: Conversation, query: str) -> list[str]:
    """The lines after a query's echo; `-` is a refusal. Raises NoAnswerError: none come."""
    wanted = VALUES.get(query, 1)
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


def state_of(talk: Conversation, *queries: str) -> ControllerState:
    """What the queries tell; what is refused or damaged is not known."""
    state = ControllerState()
    for query in queries:
        state = state_after_answer(state, query, answer(talk, query), 0.0, None) or state
    return state


def status(talk: Conversation) -> str:
    bits = state_of(talk, READ_STATUS).status
    if bits is None:
        return "status not told"
    return f"status {', '.join(describe_status(bits)) or 'all well'}"


def volts(talk: Conversation) -> str:
    state = state_of(talk, "?E")
    if state.battery_v is None or state.internal_v is None:
        return "voltages not told"
    return f"battery {state.battery_v:.1f} V, internal supply {state.internal_v:.1f} V"


def counters(talk: Conversation) -> str:
    counts = [maybe_counter(answer(talk, query)[0]) for query in READ_COUNTER]
    told = ["not readable" if count is None else str(count) for count in counts]
    return f"counters {told[0]} and {told[1]}"


def info(talk: Conversation) -> list[str]:
    bits = maybe_byte(answer(talk, READ_IDENTITY)[0]) or 0
    mode = -1 if (told := maybe_byte(answer(talk, "^00")[0])) is None else told
    doubt = "" if mode == 2 else f"; {NEEDS_WATCHDOG}"
    state = state_of(talk, READ_INPUTS, "?M")
    stop = {None: "not told", True: "PRESSED", False: "not pressed"}[state.emergency_stop]
    heat = " and ".join(f"{celsius:.0f} C" for celsius in state.celsius or ())
    return [
        f"identity {bits:02X}, {'with' if bits & ENCODER_BIT else 'WITHOUT'} encoder module",
        f"mode {MODES.get(mode, 'not told')}{doubt}",
        status(talk),
        f"emergency stop {stop}",
        volts(talk),
        f"heat sinks {heat or 'not told'}",
        counters(talk),
    ]


def watched(talk: Conversation, seconds: float | None) -> Iterator[str]:
    begun_s = talk.now_s()
    while True:
        yield f"{counters(talk)}; {volts(talk)}; {status(talk)}"
        if seconds is not None and talk.now_s() - begun_s + WATCH_S > seconds:
            return
        list(talk.hear(WATCH_S))


def parser() -> Parser:
    words = parser_of(
        "drive", __doc__, "mapod drive info", "mapod drive keys --port udp://127.0.0.1:9750"
    )
    action = words.add_actions("'serial:///dev/ax3500?baud=9600&parity=E&bytesize=7'")
    action("info", "who it is and how it is")
    action("watch", "a line each second").add_seconds("until Ctrl-C")
    action("keys", "drive by keyboard, over a planner link: the options are those of mapod view")
    return words


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused or silent, 2 wrong use."""
    arguments = list(sys.argv[1:] if given is None else given)
    if arguments[:1] == ["keys"]:
        return view.main([*arguments[1:], "--drive"], "drive keys")
    options = parser().parse_args(arguments)

    def act(talk: Conversation) -> Iterable[str]:
        check_answers(talk)
        return watched(talk, options.seconds) if options.what == "watch" else info(talk)

    return print_what(act, "drive", "drive", options, lambda url: LineParser())
