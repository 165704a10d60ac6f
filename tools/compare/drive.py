"""What a Roboteq AX3500 says and does on its line, for comparing a real one with its fake.

Reads only: nothing here can move a motor or write a parameter. With `settings` also a second of
silence, which makes the controller's watchdog say W; motors that somebody drives would stop.
"""

import re
from collections import Counter

from hw.ax3500.lines import (
    BATTERY_V,
    CR,
    INTERNAL_V,
    READ_COUNTER,
    Line,
    LineParser,
    WatchdogStop,
    encode_query,
    maybe_counter,
)
from tools.cli.conversation import Conversation, NoAnswerError, conversation
from tools.compare.facts import SILENT, Fact, Portrait, counts_in_words, delay_fact, rate_fact

LISTEN_S, ANSWER_S, WATCHDOG_S = 0.6, 0.4, 1.4
LINE_END_S = 0.05  # of silence: no line more is to come
QUERIES = ("?V", "?A", "?P", "?R", "?M", "?E", "?I", "?Q0", "?Q1", "?Q2",
           "^00", "^01", "^02", "^89", "^8A", "^8B", "^8C")  # fmt: skip
OWN = {"?A", "?P", "?R", "?M", "?E", "?Q0", "?Q1", "?Q2", "^8B", "^8C", "^02"}
LOGS = "sends logging lines: R/C or analog mode"
UNKNOWN = "?J"  # no such query: an error, and nothing happens


def portrait(url: str, seconds: float, settings: bool) -> Portrait:
    """Everything that was found out. Raises NoAnswerError: it neither sends nor answers."""
    with conversation(url, LineParser()) as talk:
        lines = [event for event in talk.hear(LISTEN_S) if isinstance(event, Line)]
        if any(line.text[:1] == ":" for line in lines):
            return {"as found": Fact(LOGS)} | _log_lines(talk, seconds)
        facts = {"as found": Fact("quiet")}
        facts.update(_line(talk, "a lone CR", CR, ""))
        for query in QUERIES:
            facts.update(_line(talk, query, encode_query(query), query))
        if not any(key.endswith(": echo") and fact.value == "yes" for key, fact in facts.items()):
            raise NoAnswerError("no echo and no answer: check baud rate, parity E and 7 bits")
        facts.update(_line(talk, f"{UNKNOWN}, which there is not", UNKNOWN.encode() + CR, UNKNOWN))
        facts.update(_pace(talk, seconds))
        if settings:
            facts.update(_silence(talk))
    return facts


def _log_lines(talk: Conversation, seconds: float) -> Portrait:
    """What it logs; a query would not be answered."""
    lines, begun_s = list[Line](), talk.now_s()
    for event in talk.hear(max(seconds, 1.0)):
        if isinstance(event, Line) and event.text.startswith(":"):
            lines.append(event)
    sizes, passed_s = Counter(len(line.text) for line in lines), talk.now_s() - begun_s
    return {
        "logging line: characters": Fact(" and ".join(str(n) for n in sorted(sizes)[-1:])),
        "logging line: rate": rate_fact(len(lines) / passed_s, passed_s),
    }


def _line(talk: Conversation, name: str, question: bytes, text: str) -> Portrait:
    lines, strays, seconds = _lines_after(talk, question, text)
    if not lines and text:
        lines, strays, seconds = _lines_after(talk, question, text)
    if not lines:
        return {f"{name}: answer": Fact(SILENT)}
    echoed = bool(text) and lines[0].upper() == text.upper()
    values = lines[1:] if echoed else lines
    return {
        f"{name}: echo": Fact("yes" if echoed else "no"),
        f"{name}: answer": Fact(_form(values)),
        f"{name}: values": Fact(" ".join(values) or "none", "own" if text in OWN else "same"),
        f"{name}: delay": delay_fact(seconds),
        **({f"{name}: W": Fact(strays, "own")} if strays else {}),
        **_volts(name, text, values),
    }


def _lines_after(talk: Conversation, question: bytes, text: str) -> tuple[list[str], int, float]:
    """The lines that follow a question, the stray W among them, and seconds to the last line.

    An answer has ended when a line besides the echo has come and then none for a while; what comes
    after that is heard before anything else is asked, and belongs to no question.
    """
    asked_s = last_s = talk.now_s()
    lines, strays = list[str](), 0
    talk.say(question)
    while talk.now_s() - asked_s < ANSWER_S or talk.now_s() - last_s < LINE_END_S:
        for event in talk.hear(LINE_END_S / 4):
            strays += isinstance(event, WatchdogStop)
            if isinstance(event, Line):
                lines.append(event.text)
                last_s = talk.now_s()
        has_answer = len(lines) > (bool(lines) and lines[0].upper() == text.upper())
        if has_answer and talk.now_s() - last_s >= LINE_END_S:
            break
    return lines, strays, last_s - asked_s


def _form(values: list[str]) -> str:
    forms = [
        "+" if value == "+"
        else "-" if value == "-"
        else "2 digits" if re.fullmatch("[0-9A-Fa-f]{2}", value)
        else "hexadecimal" if re.fullmatch("[0-9A-Fa-f]+", value)
        else "text"
        for value in values
    ]  # fmt: skip
    return ", ".join(forms) or "nothing"


def _volts(name: str, text: str, values: list[str]) -> Portrait:
    """Voltages in volts, for a person; a battery is a battery's own matter."""
    if text != "?E" or _form(values) != "2 digits, 2 digits":
        return {}
    battery_v, internal_v = int(values[0], 16) * BATTERY_V, int(values[1], 16) * INTERNAL_V
    return {
        f"{name}: battery": Fact(battery_v, "own", unit="V"),
        f"{name}: internal supply": Fact(internal_v, "own", unit="V"),
    }


def _pace(talk: Conversation, seconds: float) -> Portrait:
    begun_s, values = talk.now_s(), list[str | None]()
    while talk.now_s() < begun_s + seconds:
        values += [_maybe_value(talk, query) for query in READ_COUNTER]
    passed_s, told = talk.now_s() - begun_s, [value for value in values if value is not None]
    digits = Counter(
        "not readable" if maybe_counter(value) is None else "readable" for value in told
    )
    return {
        "counters: pairs a second": Fact(len(told) / 2 / passed_s, "near", 0.25, 1.0, "1/s"),
        "counters: queries without an answer": Fact("none" if None not in values else "some"),
        "counters: how many": Fact(counts_in_words(digits), "own"),
        "counters: are": Fact("readable" if digits.keys() <= {"readable"} else "not all readable"),
    }


def _maybe_value(talk: Conversation, query: str) -> str | None:
    """The line after the echo, at once when it is there."""
    talk.say(encode_query(query))
    echoed = False
    for event in talk.hear(ANSWER_S):
        if isinstance(event, Line):
            if echoed:
                return event.text
            echoed = event.text.upper() == query
    return None


def _silence(talk: Conversation) -> Portrait:
    begun_s = talk.now_s()
    for event in talk.hear(WATCHDOG_S):
        if isinstance(event, WatchdogStop):
            return {"W after silence": delay_fact(talk.now_s() - begun_s)}
    return {"W after silence": Fact(SILENT)}
