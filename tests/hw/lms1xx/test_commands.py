"""Commands to an LMS1xx and the values of its answers: the sheet's frames and texts."""

from datetime import datetime
from typing import Any

import pytest

from hw.lms1xx import commands
from hw.lms1xx.cola import Dialect
from hw.lms1xx.commands import Command, ScanConfig
from hw.lms1xx.telegrams import Answer, new_parser
from tests.support.devices.lms111_vectors import FRAMES, TEXTS, framed, texted

WHOLE_RANGE = framed("sWN LMPoutputRange ", bytes.fromhex("0001 000009c4 fff92230 00225510"))
BOTH_ECHOES = framed("sWN LMDscandatacfg ", b"\3\0" + bytes(8) + b"\1\0\1")


def heard(stream: bytes) -> Any:
    [event] = new_parser("auto").feed(0.0, stream)
    return event


def heard_text(text: str | bytes) -> Any:
    return heard(texted(text))


@pytest.mark.parametrize(
    ("command", "frame", "text"),
    [
        (commands.LOGIN, FRAMES["login"], TEXTS["login"]),
        (commands.READ_SCAN_CONFIG, FRAMES["read scan"], TEXTS["read scan"]),
        (commands.set_scan_config(ScanConfig(5000, 5000)), FRAMES["scan 50"], TEXTS["scan 50"]),
        (commands.set_scan_config(ScanConfig(2500, 2500)), FRAMES["scan 25"], None),
        (commands.READ_OUTPUT_RANGE, FRAMES["read range"], None),
        (commands.READ_CONTENT, FRAMES["read content"], None),
        (commands.START_MEASURING, FRAMES["start"], None),
        (commands.STOP_MEASURING, FRAMES["stop"], None),
        (commands.STORE, FRAMES["store"], None),
        (commands.RUN, FRAMES["run"], "sMN Run"),
        (commands.REBOOT, FRAMES["reboot"], None),
        (commands.READ_STATE, FRAMES["read state"], None),
        (commands.READ_DEVICE_STATE, FRAMES["read device state"], None),
        (commands.READ_CONTAMINATION, FRAMES["read contamination"], None),
        (
            commands.set_clock(datetime(2021, 3, 2, 12, 34, 56, 789_000)),
            FRAMES["set time"],
            TEXTS["set time"],
        ),
        # these texts are written out as the sheet writes its own
        (commands.subscribe(), FRAMES["subscribe"], "sEN LMDscandata 1"),
        (commands.subscribe(False), FRAMES["unsubscribe"], "sEN LMDscandata 0"),
        (commands.set_dialect("ascii"), FRAMES["set ascii"], "sWN EIHstCola 0"),
        (commands.set_dialect("binary"), FRAMES["set binary"], "sWN EIHstCola 1"),
        (
            commands.set_content("first"),
            FRAMES["write content"],
            "sWN LMDscandatacfg 01 00 0 0 0 00 00 0 0 0 1 +1",
        ),
        (
            commands.set_content("both"),
            BOTH_ECHOES,
            "sWN LMDscandatacfg 03 00 0 0 0 00 00 0 0 0 1 +1",
        ),
        (commands.set_output_range(2500), WHOLE_RANGE, "sWN LMPoutputRange 1 9C4 FFF92230 225510"),
    ],
)
def test_commands_are_the_sheets(command: Command, frame: bytes, text: str | bytes | None) -> None:
    assert command.encode("binary").hex(" ", 4) == frame.hex(" ", 4)
    if text is not None:
        assert command.encode("ascii") == texted(text)


# --- answers


def test_settings_are_read_in_both_dialects() -> None:
    assert commands.maybe_scan_config(heard(FRAMES["scan is 25"])) == ScanConfig(2500, 2500)
    assert commands.maybe_scan_config(heard_text(TEXTS["scan is 50"])) == ScanConfig(5000, 5000)
    assert commands.maybe_output_range_deg(heard(FRAMES["range is"])) == (-44.9997, 224.9997)
    assert commands.maybe_output_range_deg(heard_text(TEXTS["range is"])) == (-45.0, 225.0)
    assert commands.maybe_content(heard(FRAMES["content is"])) == commands.content("first")
    lower = heard_text("sRA LMDscandatacfg 1  0 0 0 0 0 0 00 0 0 01 +1 ")
    assert commands.maybe_content(lower) == commands.content("first")


@pytest.mark.parametrize("dialect", ["binary", "ascii"])
@pytest.mark.parametrize("values", [b"", b"\x00", b"0 1 xyz", b"1 2 3 4 5 6 7 8" * 3])
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
    assert commands.maybe_texts(heard_text(TEXTS["location"])) == ("not defined",)
    decimal = "sRA DeviceIdent 16 LMS10x_FieldEval 16 V1.36-21.10.2010"
    for ident in (TEXTS["ident"], decimal):
        texts = commands.maybe_texts(heard_text(ident), 2)
        assert texts == ("LMS10x_FieldEval", "V1.36-21.10.2010")
    assert commands.maybe_texts(heard_text("sRA DeviceIdent"), 2) is None
    assert commands.maybe_texts(Answer("sRA", "FirmwareVersion", b"\x00\x09V1")) is None


def test_counters_are_read() -> None:
    hours = Answer("sRA", "ODoprh", bytes.fromhex("0004563c"))
    assert commands.maybe_hours(hours) == 28422.0
    assert commands.maybe_hours(heard_text("sRA ODoprh 4563C")) == 28422.0
    assert commands.maybe_hours(heard_text("sRA ODoprh")) is None
    assert commands.maybe_number(heard_text("sRA ODpwrc 3F"), "I") == 63


def test_methods_differ_in_what_they_call_good() -> None:
    good = [FRAMES["logged in"], FRAMES["range written"]]
    good += [texted(f"sAN {text}") for text in ("LMCstartmeas 0", "mEEwriteall 1", "mSCreboot")]
    assert all(commands.is_good(heard(telegram)) for telegram in good)
    bad = (FRAMES["not logged in"], texted("sAN LMCstopmeas 1"), texted("sAN Run"))
    assert not any(commands.is_good(heard(telegram)) for telegram in bad)
