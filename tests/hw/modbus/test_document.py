"""docs/modbus.md says what the code does: its tables are made from it, its rules are tried here."""

import re

from hw.modbus import layout
from hw.modbus.layout import Refusal
from tools.docs.modbus_table import DOCUMENT, MARKS, MEANINGS, SECTIONS, filled

TEXT = DOCUMENT.read_text(encoding="utf-8")


def test_the_document_has_every_table_of_the_code_once() -> None:
    assert filled(TEXT) == TEXT
    assert filled(MARKS.sub(r"<!-- begin \1 -->\nold\n<!-- end \1 -->", TEXT)) == TEXT
    names = [found[1] for found in MARKS.finditer(TEXT)]
    assert sorted(names) == sorted(SECTIONS)
    assert set(MEANINGS) == set(Refusal) - {Refusal.NONE}


def test_registers_that_the_text_names_are_where_it_says() -> None:
    blocks = [layout.STATUS_BLOCK, layout.DRIVE_BLOCK, layout.window_block(101)]
    places = {(entry.name, entry.address) for block in blocks for entry in block.entries}
    named = {(name, int(at)) for name, at in re.findall(r"`(\w+)` \((\d+)\)", TEXT)}
    assert len(named) > 8
    assert named <= places
