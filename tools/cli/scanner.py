"""What a person may want of a laser scanner beside its scans.

Who it is and how it is; storing its settings for good (which wears its memory out, so mapod never
does it by itself), setting its clock or its dialect, start, stop, reboot. The port is that of
mapod.toml, or --port. Whatever needs a login ends with Run, or the device would stay busy; mapod,
if it is connected, sees that and begins again. A Hokuyo scanner knows info, start, stop and reboot;
with --port it is one on a serial line or at port 10940, else scanner.driver tells.
"""

from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import get_args

from core.config import ConfigError
from hw.lms1xx import commands
from hw.lms1xx.cola import ColaParser, Dialect
from hw.lms1xx.commands import Command
from hw.lms1xx.status import CONTAMINATIONS, HOT, STATES
from hw.lms1xx.telegrams import Answer, Refusal, Telegram, new_parser
from hw.urg04lx.scip import ScipParser
from tools.cli import scip
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError, print_what
from tools.cli.options import Parser, configured, parser_of

DIALECTS: tuple[Dialect, ...] = get_args(Dialect)
SICK, HOKUYO = "lms111", "urg04lx"  # drivers
PROBE_S, ANSWER_S = 0.7, 2.5


class Scanner:
    """One connection, in the dialect that the device was found to speak."""

    def __init__(self, talk: Conversation, dialect: Dialect) -> None:
        self.dialect = dialect
        self._talk = talk

    def ask(self, command: Command) -> Answer:
        """Asked once: late answers are not taken for others. Raises NoAnswerError, RefusedError."""

        def is_answer(event: object) -> bool:
            return isinstance(event, Refusal) or command.is_answered_by(event)

        try:
            event = self._talk.ask(command.encode(self.dialect), is_answer, ANSWER_S, tries=1)
        except NoAnswerError:
            raise NoAnswerError(f"no answer to {command.name} within {ANSWER_S:g} s") from None
        if isinstance(event, Refusal):
            raise RefusedError(f"the scanner refuses {command.name}: {event.reason}")
        assert isinstance(event, Answer)
        return event

    def do(self, command: Command) -> None:
        if not commands.is_good(self.ask(command)):
            raise RefusedError(f"the scanner says that {command.name} failed")

    def logged_in(self, *wanted: Command) -> None:
        """Commands that need a login; Run follows, whatever became of them."""
        self.do(commands.LOGIN)
        try:
            for command in wanted:
                self.do(command)
        finally:
            self.do(commands.RUN)


def dialect_of(talk: Conversation) -> Dialect:
    """In which one it answers or refuses. Raises NoAnswerError: it answers in neither."""
    for _ in range(2):
        for dialect in DIALECTS:
            talk.say(commands.READ_DEVICE_STATE.encode(dialect))
            for event in talk.hear(PROBE_S):
                if isinstance(event, Answer | Refusal):
                    return dialect
    raise NoAnswerError(
        "no answer in CoLa-B nor in CoLa-A: is it a SICK scanner, and has it started?"
    )


def _text(answer: Answer) -> str:
    return (commands.maybe_texts(answer) or ("not told",))[0]


def _number(answer: Answer) -> str:
    return str(commands.maybe_number(answer, "I"))


def _state(answer: Answer) -> str:
    state, temperature_ok = commands.maybe_state(answer) or (-1, None)
    words = f"state: {STATES.get(state, f'{state}, not listed')}"
    return words + (f"; it {HOT}" if temperature_ok is False else "")


def _contamination(answer: Answer) -> str:
    degree = commands.maybe_number(answer) or 0
    return f"window: {CONTAMINATIONS.get(degree, 'clean')}"


def _scan_config(answer: Answer) -> str:
    config = commands.maybe_scan_config(answer)
    if config is None:
        return "scan rate and step: not told"
    return f"{config.centihertz / 100:g} scans/s in steps of {config.step / 10_000:g} deg"


def _output_range(answer: Answer) -> str:
    span_deg = commands.maybe_output_range_deg(answer)
    return (
        f"sends {span_deg[0]:g} to {span_deg[1]:g} deg" if span_deg else "field of view: not told"
    )


Question = tuple[Command, Callable[[Answer], str]]
WHO: tuple[Question, ...] = (
    (commands.READ_IDENT, lambda answer: " ".join(commands.maybe_texts(answer, 2) or ())),
    (commands.READ_FIRMWARE, lambda answer: f"firmware {_text(answer)}"),
)
HOW: tuple[Question, ...] = (
    (commands.READ_LOCATION, lambda answer: f"location {_text(answer)}"),
    (commands.READ_HOURS, lambda answer: f"{commands.maybe_hours(answer)} hours of operation"),
    (commands.READ_POWER_ONS, lambda answer: f"{_number(answer)} times powered on"),
    (commands.READ_STATE, _state),
    (commands.READ_CONTAMINATION, _contamination),
    (commands.READ_SCAN_CONFIG, _scan_config),
    (commands.READ_OUTPUT_RANGE, _output_range),
)


def told(scanner: Scanner, questions: tuple[Question, ...] = WHO + HOW) -> list[str]:
    """Its dialect, and the answers; one that is not given is named."""
    lines = [f"speaks CoLa-{'B (binary)' if scanner.dialect == 'binary' else 'A (ascii)'}"]
    for command, in_words in questions:
        try:
            lines.append(in_words(scanner.ask(command)))
        except (RefusedError, NoAnswerError) as error:
            lines.append(f"{command.name} not told: {error}")
    return lines


def act(scanner: Scanner, what: str, dialect: Dialect) -> list[str]:
    now = datetime.now()
    needs_login = {
        "store": (commands.STORE, "its settings are stored, and outlast a loss of power"),
        "set-clock": (commands.set_clock(now), f"its clock is set to {now:%Y-%m-%d %H:%M:%S}"),
        "start": (commands.START_MEASURING, "it measures"),
        "stop": (commands.STOP_MEASURING, "it does not measure any more, until mapod starts it"),
        "dialect": (
            commands.set_dialect(dialect),
            f"it speaks {dialect} from the next connection on; that may take up to 30 s",
        ),
    }
    if what == "info":
        return told(scanner)
    if what == "reboot":
        scanner.do(commands.LOGIN)
        scanner.do(commands.REBOOT)
        return ["it starts anew, which takes up to 30 s"]
    command, done = needs_login[what]
    scanner.logged_in(command)
    return [done]


def parser() -> Parser:
    words = parser_of("scanner", __doc__, "mapod scanner info", "mapod scanner dialect ascii")
    action = words.add_actions("tcp://192.168.0.1:2112")
    action("info", "who it is and how it is")
    action("store", "keep its settings over a loss of power (wears its memory out)")
    action("set-clock", "to this machine's local time")
    action("start", "measuring")
    action("stop", "measuring")
    action("reboot", "power off and on, as it were")
    dialect = action("dialect", "of the host port: CoLa-B or CoLa-A")
    dialect.add_argument("dialect", choices=DIALECTS)
    return words


def main(given: list[str] | None = None) -> int:
    """Exit status: 0 done, 1 refused or silent, 2 wrong use."""
    options = parser().parse_args(given)

    is_scip = False

    def new(url: str) -> ScipParser | ColaParser[Telegram]:
        nonlocal is_scip
        is_scip = is_of_scip(url) if options.port else is_set_to_scip(options.config)
        return ScipParser() if is_scip else new_parser("auto")

    def do(talk: Conversation) -> list[str]:
        if is_scip:
            return scip.act(talk, options.what)
        scanner = Scanner(talk, dialect_of(talk))
        return act(scanner, options.what, getattr(options, "dialect", "binary"))

    return print_what(do, "scanner", "scanner", options, new)


def is_of_scip(url: str) -> bool:
    """Whether a port is one of a Hokuyo scanner: SICK's have no serial line, and other ports."""
    return url.startswith("serial:") or url.endswith(f":{scip.PORT}")


def is_set_to_scip(path: Path) -> bool:
    """The same of the scanner in settings. Raises ConfigError: it is neither of both."""
    driver = configured(path).scanner.driver
    if driver not in (SICK, HOKUYO):
        raise ConfigError(f"scanner.driver: must be {SICK!r} or {HOKUYO!r}, is {driver!r}")
    return driver == HOKUYO
