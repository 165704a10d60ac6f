"""The table of causes: whole, of one state each, and as the protocol prints it."""

import re

from core.mapping import causes
from core.mapping.causes import CAUSES, Cause, state_of
from core.records import FREE, OBSTACLE, UNKNOWN
from tests import ROOT


def test_each_cause_has_a_code_of_its_states_range_a_word_and_a_sentence() -> None:
    codes = {name: code for name, code in vars(causes).items() if name.isupper()}
    for other in ("CAUSES", "LOW_GROUND", "OUTSIDE", "FIRST_FREE", "FIRST_OBSTACLE", "FIRST_DOUBT"):
        del codes[other]
    for state in ("UNKNOWN", "FREE", "OBSTACLE"):
        del codes[state]
    assert sorted(codes.values()) == sorted(CAUSES)
    assert {state_of(code) for code in range(1, 64)} == {UNKNOWN}
    assert {state_of(code) for code in range(64, 128)} == {FREE}
    assert {state_of(code) for code in range(128, 192)} == {OBSTACLE}
    assert {state_of(code) for code in range(192, 256)} == {UNKNOWN}
    words = [cause.word for cause in CAUSES.values() if cause.word != "before"]
    assert len(words) == len(set(words)) == len(CAUSES) - 3
    assert all(cause.sentence.endswith(".") for cause in CAUSES.values())


def test_the_protocol_prints_the_table() -> None:
    sheet = (ROOT / "docs" / "protocols" / "planner-link.md").read_text(encoding="utf-8")
    section = sheet.split("| cause | word | rule |")[1].split("### SCAN")[0]
    told = re.findall(r"^\| (\d+) \| ([a-z-]+) \| (.*) \|$", section, re.MULTILINE)
    assert {int(code): Cause(word, rule) for code, word, rule in told} == CAUSES
