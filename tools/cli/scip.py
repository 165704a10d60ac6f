"""What a person may want of a Hokuyo scanner: the same words as for other scanners, over SCIP.

At whatever rate its port is set to; a scanner that speaks SCIP 1.1 is switched over, and one that
streams for a host that has gone is stopped, as mapod does.
"""

from collections.abc import Callable, Mapping

from hw.urg04lx.conversation import FOUND_S, LONGEST_REPLY
from hw.urg04lx.scip import Reply, encode_request
from hw.urg04lx.sensor import OK, SCIP1_REFUSES, UNKNOWN, describe_status, texts_of
from tools.cli.conversation import Conversation, NoAnswerError, RefusedError

PORT = "10940"  # of those on Ethernet
ANSWER_S, QUIET_S = 0.5, 0.14
STREAM_BYTES = 64  # unasked in QUIET_S; what it still answers to others is shorter
WHO = {"VV": ("PROD", "FIRM", "SERI")}
HOW = {**WHO, "PP": ("MODL", "DMIN", "DMAX", "ARES", "SCAN"), "II": ("LASR", "MESM", "STAT")}
WORDS = {
    "PROD": "product {}",
    "FIRM": "firmware {}",
    "SERI": "serial number {}",
    "MODL": "model {}",
    "DMIN": "measures from {} mm",
    "DMAX": "to {} mm",
    "ARES": "{} steps a turn",
    "SCAN": "{} turns a minute",
    "LASR": "laser {}",
    "MESM": "state {}",
    "STAT": "says: {}",
}
NOT_KNOWN = "a Hokuyo scanner has no such command: allowed are info, start, stop and reboot"


def ask(talk: Conversation, command: str, tries: int = 2, wait_s: float = ANSWER_S) -> Reply:
    """The reply, which may stand behind a scan that is on its way. Raises NoAnswerError."""

    def is_reply(event: object) -> bool:
        return isinstance(event, Reply) and event.command == command

    seconds = wait_s + talk.line_s(LONGEST_REPLY)
    reply: Reply = talk.ask(encode_request(command), is_reply, seconds, tries)
    return reply


def do(talk: Conversation, command: str, *good: str) -> None:
    """Raises RefusedError, NoAnswerError."""
    reply = ask(talk, command)
    if reply.status not in (good or (OK,)):
        why = describe_status(reply.status, command)
        raise RefusedError(f"the scanner refuses {command}: {why}")


def greet(talk: Conversation) -> None:
    """It speaks SCIP 2.0, and takes commands. Raises NoAnswerError: it is none."""
    before = len(talk.heard)
    talk.say(b"\n")  # ends what others have begun to say
    for _ in talk.hear(QUIET_S):
        pass
    if len(talk.heard) - before > STREAM_BYTES:
        ask(talk, "QT", 1, FOUND_S)
    reply = ask(talk, "PP", 1, FOUND_S)  # of VV some damage a line
    if reply.status == SCIP1_REFUSES:
        ask(talk, "SCIP2.0")
    elif reply.status in UNKNOWN:
        ask(talk, "TM2")


def told(talk: Conversation, questions: Mapping[str, tuple[str, ...]] = HOW) -> list[str]:
    """Its answers, a line each; one that is not given is named."""
    lines = ["speaks SCIP 2.0"]
    for command, keys in questions.items():
        try:
            texts = texts_of(ask(talk, command))
        except NoAnswerError as error:
            lines.append(f"{command} not told: {error}")
            continue
        lines += [WORDS[key].format(texts[key]) for key in keys if key in texts]
    return lines


def _stop(talk: Conversation) -> list[str]:
    do(talk, "QT")
    return ["its laser is off"]


def _start(talk: Conversation) -> list[str]:
    do(talk, "BM", OK, "02")
    return ["its laser is on"]


def _reset(talk: Conversation) -> list[str]:
    do(talk, "RS")
    return ["its settings are those of power on"]


ACTIONS: dict[str, Callable[[Conversation], list[str]]] = {
    "info": told,
    "start": _start,
    "stop": _stop,
    "reboot": _reset,
}


def act(talk: Conversation, what: str) -> list[str]:
    """Raises RefusedError, NoAnswerError."""
    if what not in ACTIONS:
        raise RefusedError(NOT_KNOWN)
    greet(talk)
    return ACTIONS[what](talk)
