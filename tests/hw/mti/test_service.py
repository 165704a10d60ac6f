"""What a person may want of an MTi: the sheet's frames byte for byte, answers in words."""

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.mti import service as commands
from hw.mti.service import OrientationReset, Scenario
from tests.support.mti_frames import configuration, framed, wire


@pytest.mark.parametrize(
    ("encoded", "frame"),
    [
        (commands.encode_req_configuration(), wire("ReqConfiguration")),
        (commands.encode_req_scenarios(), wire("ReqAvailableScenarios")),
        (commands.encode_req_scenario(), wire("ReqScenario")),
        (commands.encode_set_scenario(3), wire("SetScenario")),
        (commands.encode_reset_orientation(OrientationReset.HEADING), wire("ResetOrientation")),
        (
            commands.encode_reset_orientation(OrientationReset.ALIGNMENT),
            wire("ResetOrientation", 1),
        ),
        (commands.encode_reset_orientation(OrientationReset.STORE), wire("ResetOrientation", 2)),
        (commands.encode_set_baudrate(115200), wire("SetBaudrate")),
        (commands.encode_set_baudrate(921600), wire("SetBaudrate", 1)),
        (commands.encode_no_rotation(10), framed(0x22, b"\x00\x0a")),
        (commands.encode_self_test(), framed(0x24)),
    ],
)
def test_requests_are_those_of_the_sheet(encoded: bytes, frame: bytes) -> None:
    assert encoded == frame


def test_what_cannot_be_asked_is_our_mistake() -> None:
    for kind in (0, 256):
        with pytest.raises(ValueError, match="kind"):
            commands.encode_set_scenario(kind)
    with pytest.raises(ValueError, match="seconds"):
        commands.encode_no_rotation(65536)
    with pytest.raises(ValueError, match="115200"):
        commands.encode_set_baudrate(115201)


def test_the_list_of_filter_profiles_leaves_empty_places_out() -> None:
    entry = bytes([3, 8]) + b"machine".ljust(20)
    other = bytes([6, 8]) + b"machine_nomagfield".ljust(20)
    data = entry + bytes(22) + other + bytes(44)
    assert commands.decode_scenarios(data) == [
        Scenario(3, 8, "machine"),
        Scenario(6, 8, "machine_nomagfield"),
    ]


def test_the_profile_in_use_has_its_version_first() -> None:
    assert commands.maybe_scenario(wire("Scenario")[4:-1]) == Scenario(kind=3, version=8)
    assert commands.maybe_scenario(b"\x03") is None


def test_a_self_test_names_what_failed() -> None:
    assert commands.maybe_failed_tests(b"\x01\xff") == []
    assert commands.maybe_failed_tests(b"\x00\xfe") == ["acceleration x", "magnetic field z"]
    assert commands.maybe_failed_tests(b"\xff") is None


def test_the_configuration_of_the_sheet_is_taken_apart() -> None:
    data = configuration("0032 0006 00000005")[4:-1]
    found = commands.maybe_configuration(data)
    assert found == commands.MtConfiguration(1152, 0, 6, 5, (2, 6, 1))
    assert found.rate_hz == 100.0
    assert commands.maybe_configuration(data[1:]) is None


@pytest.mark.parametrize(
    ("tail", "mode", "firmware"),
    [
        ("01500618 0036 0006 00000001 070A 020601 360202", 6, (2, 6, 1)),
        ("0368248C 0000 0000 00000000 0027 010702 490501", 0, (1, 7, 2)),
    ],
)
def test_the_tails_of_real_devices_are_read(
    tail: str, mode: int, firmware: tuple[int, int, int]
) -> None:
    found = commands.maybe_configuration(bytes(98) + bytes.fromhex(tail))
    assert found is not None
    assert (found.output_mode, found.firmware, found.rate_hz) == (mode, firmware, 0.0)


@pytest.mark.parametrize("number", range(1, 6))
def test_recorded_output_configurations_are_read(vectors: Path, number: int) -> None:
    data = (vectors / f"mti_rec{number}.cfg.bin").read_bytes()
    outputs = commands.decode_output_configuration(data)
    assert b"".join(struct.pack(">HH", *output) for output in outputs) == data


@given(st.binary(max_size=150))
def test_no_answer_makes_a_decoder_raise(data: bytes) -> None:
    commands.maybe_configuration(data)
    commands.maybe_configuration(data.ljust(118, b"\xff"))
    commands.decode_scenarios(data)
    commands.maybe_scenario(data)
    commands.maybe_failed_tests(data)
    commands.decode_output_configuration(data)
