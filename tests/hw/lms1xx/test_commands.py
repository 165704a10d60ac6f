"""Commands to an LMS1xx and the values of its answers: the sheet's frames and texts."""

from datetime import datetime
from typing import Any

import pytest

from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect
from hw.lms1xx.commands import Command, ScanConfig
from hw.lms1xx.telegrams import Answer, new_parser
from tests.support.lms111_vectors import FRAMES, TEXTS, texted

TIME = datetime(2021, 3, 2, 12, 34, 56, 789_000)


def heard(stream: bytes) -> Any:
    [event] = new_parser("auto").feed(0.0, stream)
    return event


def heard_text(text: str | bytes) -> Any:
    return heard(texted(text))


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("login", commands.login()),
        ("login 2", commands.login(2, 0xB21ACE26)),
        ("login 4", commands.login(4, 0x81BE23AA)),
        ("read scan", commands.READ_SCAN_CONFIG),
        ("scan 50", commands.set_scan_config(ScanConfig(5000, 5000))),
        ("scan 25", commands.set_scan_config(ScanConfig(2500, 2500))),
        ("read range", commands.READ_OUTPUT_RANGE),
        ("write range 180", commands.set_output_range(5000, 0, 1_800_000)),
        ("write range", commands.set_output_range(5000, -449_997, 2_249_997)),
        ("write content", commands.set_content("first")),
        ("read content", commands.READ_CONTENT),
        ("start", commands.START_MEASURING),
        ("stop", commands.STOP_MEASURING),
        ("store", commands.STORE),
        ("run", commands.RUN),
        ("reboot", commands.REBOOT),
        ("read state", commands.READ_STATE),
        ("read device state", commands.READ_DEVICE_STATE),
        ("read contamination", commands.READ_CONTAMINATION),
        ("subscribe", commands.subscribe()),
        ("unsubscribe", commands.subscribe(False)),
        ("set time", commands.set_clock(TIME)),
        ("set ascii", commands.set_dialect("ascii")),
        ("set binary", commands.set_dialect("binary")),
    ],
)
def test_commands_are_the_sheets_frames(name: str, command: Command) -> None:
    assert command.encode("binary").hex(" ", 4) == FRAMES[name].hex(" ", 4)


@pytest.mark.parametrize(
    ("command", "text"),
    [
        (commands.login(), TEXTS["login"]),
        (commands.READ_SCAN_CONFIG, TEXTS["read scan"]),
        (commands.set_scan_config(ScanConfig(5000, 5000)), TEXTS["scan 50"]),
        (commands.set_output_range(5000, 0, 1_800_000), TEXTS["write range 180"]),
        (commands.set_clock(TIME), TEXTS["set time"]),
        # these are written out as the sheet writes its own
        (commands.set_content("first"), "sWN LMDscandatacfg 01 00 0 0 0 00 00 0 0 0 1 +1"),
        (commands.set_content("both"), "sWN LMDscandatacfg 03 00 0 0 0 00 00 0 0 0 1 +1"),
        (commands.set_output_range(2500), "sWN LMPoutputRange 1 9C4 FFF92230 225510"),
        (commands.subscribe(), "sEN LMDscandata 1"),
        (commands.subscribe(False), "sEN LMDscandata 0"),
        (commands.set_dialect("binary"), "sWN EIHstCola 1"),
        (commands.RUN, "sMN Run"),
    ],
)
def test_commands_are_the_sheets_texts(command: Command, text: str | bytes) -> None:
    assert command.encode("ascii") == texted(text)


def test_both_echoes_are_asked_for_where_one_is_not_enough() -> None:
    for echo in ("last", "both"):
        frame = commands.set_content(echo).encode("binary")
        assert frame[8:-1] == b"sWN LMDscandatacfg \3\0" + bytes(8) + b"\1\0\1"


# --- answers


def test_settings_are_read_in_both_dialects() -> None:
    assert commands.maybe_scan_config(heard(FRAMES["scan is 25"])) == ScanConfig(2500, 2500)
    assert commands.maybe_scan_config(heard_text(TEXTS["scan is 50"])) == ScanConfig(5000, 5000)
    taken = commands.maybe_taken_config(heard(FRAMES["scan 25 taken"]))
    assert taken == (0, ScanConfig(2500, 2500))
    taken = commands.maybe_taken_config(heard_text(TEXTS["scan 50 taken"]))
    assert taken == (0, ScanConfig(5000, 5000))
    assert commands.maybe_output_range_deg(heard(FRAMES["range is"])) == (-44.9997, 224.9997)
    assert commands.maybe_output_range_deg(heard_text(TEXTS["range is"])) == (-45.0, 225.0)
    assert commands.maybe_content(heard(FRAMES["content is"])) == commands.content("first")
    lower = heard_text("sRA LMDscandatacfg 1  0 0 0 0 0 0 00 0 0 01 +1 ")
    assert commands.maybe_content(lower) == commands.content("first")


@pytest.mark.parametrize("dialect", ["binary", "ascii"])
@pytest.mark.parametrize("values", [b"", b"\x00", b"0 1 xyz", b"00", b"1 2 3 4 5 6 7 8" * 3])
def test_values_that_are_something_else_are_none(values: bytes, dialect: Dialect) -> None:
    assert commands.maybe_scan_config(Answer("sRA", "LMPscancfg", values, dialect)) is None
    assert commands.maybe_content(Answer("sRA", "LMDscandatacfg", values, dialect)) is None
    range_is = Answer("sRA", "LMPoutputRange", values, dialect)
    assert commands.maybe_output_range_deg(range_is) is None


def test_states_are_read_whichever_way_they_are_written() -> None:
    binary = [b"\x00\x07\x00rest", b"\x00\x04\x01", b"7", b"6 1 8 00:34:19", b"\x00\x05", b"\x07"]
    states = [commands.maybe_state(Answer("sRA", "STlms", values)) for values in binary]
    assert states == [(7, True), (4, False), (7, None), (6, False), (5, None), None]
    assert commands.maybe_state(heard_text(TEXTS["state is 7"])) == (7, True)
    assert commands.maybe_state(heard_text("sRA STlms 07 1")) == (7, False)
    assert commands.maybe_state(heard_text("sRA STlms")) is None


def test_texts_are_read_by_their_lengths() -> None:
    firmware = Answer("sRA", "FirmwareVersion", b"\x00\x09V1.80.2  ")
    assert commands.maybe_texts(firmware) == ("V1.80.2",)
    assert commands.maybe_texts(heard_text(TEXTS["firmware"])) == ("V1.80.1",)
    ident = heard_text(TEXTS["ident"])
    assert commands.maybe_texts(ident, 2) == ("LMS10x_FieldEval", "V1.36-21.10.2010")
    assert commands.maybe_texts(heard_text(TEXTS["location"])) == ("not defined",)
    decimal = heard_text("sRA DeviceIdent 16 LMS10x_FieldEval 16 V1.36-21.10.2010")
    assert commands.maybe_texts(decimal, 2) == ("LMS10x_FieldEval", "V1.36-21.10.2010")
    assert commands.maybe_texts(heard_text("sRA DeviceIdent"), 2) is None
    assert commands.maybe_texts(Answer("sRA", "FirmwareVersion", b"\x00\x09V1")) is None


def test_counters_are_read() -> None:
    hours = Answer("sRA", "ODoprh", bytes.fromhex("0004563c"))
    assert commands.maybe_hours(hours) == 28422.0
    assert commands.maybe_hours(heard_text("sRA ODoprh 4563C")) == 28422.0
    assert commands.maybe_hours(heard_text("sRA ODoprh")) is None
    assert commands.maybe_number(heard_text("sRA ODpwrc 3F"), "I") == 63
    assert commands.maybe_number(heard(FRAMES["clean"])) == 0


def test_methods_differ_in_what_they_call_good() -> None:
    assert commands.is_good(heard(FRAMES["logged in"]))
    assert not commands.is_good(heard(FRAMES["not logged in"]))
    assert commands.is_good(heard(FRAMES["range written"]))
    assert commands.is_good(heard_text("sAN LMCstartmeas 0"))
    assert not commands.is_good(heard_text("sAN LMCstopmeas 1"))
    assert commands.is_good(heard_text("sAN mEEwriteall 1"))
    assert commands.is_good(heard_text("sAN mSCreboot"))
    assert not commands.is_good(heard_text("sAN Run"))
