"""docs/modbus.md says what the code does: its tables are made from it, its rules are tried here."""

import re
from pathlib import Path

from hw.modbus import layout
from hw.modbus.layout import Refusal
from tools.docs.modbus_table import DOCUMENT, MARKS, MEANINGS, SECTIONS, filled, main

TEXT = DOCUMENT.read_text(encoding="utf-8")


def test_the_document_has_every_table_of_the_code_once() -> None:
    assert filled(TEXT) == TEXT
    names = [found[1] for found in MARKS.finditer(TEXT)]
    assert sorted(names) == sorted(SECTIONS)
    assert set(MEANINGS) == set(Refusal) - {Refusal.NONE}


def test_the_tool_writes_what_is_missing_and_finds_what_is_wrong(tmp_path: Path) -> None:
    copy = tmp_path / "modbus.md"
    copy.write_text(MARKS.sub(r"<!-- begin \1 -->\nold\n<!-- end \1 -->", TEXT), encoding="utf-8")
    assert main(["--check", str(copy)]) == 1
    assert main([str(copy)]) == 0
    assert copy.read_text(encoding="utf-8") == TEXT


def test_registers_that_the_text_names_are_where_it_says() -> None:
    blocks = [layout.STATUS_BLOCK, layout.DRIVE_BLOCK, layout.window_block(101)]
    places = {(entry.name, entry.address) for block in blocks for entry in block.entries}
    named = {(name, int(at)) for name, at in re.findall(r"`(\w+)` \((\d+)\)", TEXT)}
    assert len(named) > 8
    assert named <= places
