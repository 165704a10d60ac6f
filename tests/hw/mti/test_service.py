"""What a person may want of an MTi: the sheet's frames byte for byte, answers in words."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.mti import service as commands
from hw.mti.service import OrientationReset, Scenario
from tests.support.scripted_mti import configuration, framed, wire


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
        (commands.encode_reset(), wire("Reset")),
        (commands.encode_restore_factory(), wire("RestoreFactoryDef")),
        (commands.encode_req_baudrate(), wire("ReqBaudrate")),
        (commands.encode_set_baudrate(115200), wire("SetBaudrate")),
        (commands.encode_set_baudrate(921600), wire("SetBaudrate", 1)),
        (commands.encode_output_configuration([]), wire("ReqOutputConfiguration")),
        (
            commands.encode_output_configuration(
                [
                    (0x1020, 0xFFFF),
                    (0x1060, 0xFFFF),
                    (0x2030, 100),
                    (0x4020, 100),
                    (0x8020, 100),
                    (0xE020, 0xFFFF),
                ]
            ),
            wire("SetOutputConfiguration", 1),
        ),
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
    with pytest.raises(ValueError, match="32"):
        commands.encode_output_configuration([(0x1020, 0)] * 33)


def test_the_list_of_filter_profiles_leaves_empty_places_out() -> None:
    entry = bytes([3, 8]) + b"machine".ljust(20)
    other = bytes([6, 8]) + b"machine_nomagfield".ljust(20)
    data = entry + bytes(22) + other + bytes(44)
    assert commands.decode_scenarios(data) == [
        Scenario(3, 8, "machine"),
        Scenario(6, 8, "machine_nomagfield"),
    ]


def test_the_profile_in_use_has_its_version_first() -> None:
    assert commands.decode_scenario(wire("Scenario")[4:-1]) == Scenario(kind=3, version=8)
    assert commands.decode_scenario(b"\x03") is None


def test_a_self_test_names_what_failed() -> None:
    assert commands.decode_self_test(b"\x01\xff") == []
    assert commands.decode_self_test(b"\x00\xfe") == ["acceleration x", "magnetic field z"]
    assert commands.decode_self_test(b"\xff") is None


def test_the_configuration_of_the_sheet_is_taken_apart() -> None:
    found = commands.decode_configuration(configuration("0032 0006 00000005")[4:-1])
    assert found is not None
    assert (found.master_id, found.device_id, found.devices) == (0x300D2A, 0x300D2A, 1)
    assert (found.period, found.skip, found.rate_hz) == (1152, 0, 100.0)
    assert (found.data_bytes, found.output_mode, found.output_settings) == (50, 6, 5)
    assert found.scenario == Scenario(kind=3, version=0)
    assert found.firmware == (2, 6, 1)
    assert (found.filter_type, found.filter_version) == ("3", (2, 8))
    assert (found.date, found.time, found.sync_in) == ("", "", (0, 0, 0))
    assert commands.decode_configuration(bytes(117)) is None


@pytest.mark.parametrize(
    ("tail", "device_id", "size", "scenario", "firmware", "filter_type"),
    [
        ("01500618 0036 0006 00000001 070A 020601 360202", 0x01500618, 54, (10, 7), (2, 6, 1), "6"),
        ("0368248C 0000 0000 00000000 0027 010702 490501", 0x0368248C, 0, (39, 0), (1, 7, 2), "I"),
    ],
)
def test_the_tails_of_real_devices_are_read(
    tail: str,
    device_id: int,
    size: int,
    scenario: tuple[int, int],
    firmware: tuple[int, int, int],
    filter_type: str,
) -> None:
    found = commands.decode_configuration(bytes(98) + bytes.fromhex(tail))
    assert found is not None
    assert (found.device_id, found.data_bytes, found.firmware) == (device_id, size, firmware)
    assert (found.scenario.kind, found.scenario.version) == scenario
    assert (found.filter_type, found.rate_hz) == (filter_type, 0.0)


def test_every_baud_rate_has_its_code_and_the_second_code_is_known_too() -> None:
    for baud in commands.BAUD_CODES:
        frame = commands.encode_set_baudrate(baud)
        assert commands.decode_baudrate(frame[4:-1]) == baud
    assert commands.decode_baudrate(b"\x0a") == 921600
    assert commands.decode_baudrate(b"\x55") is None
    assert commands.decode_baudrate(b"") is None


@pytest.mark.parametrize("number", range(1, 6))
def test_recorded_output_configurations_are_lists_that_encode_back(
    vectors: Path, number: int
) -> None:
    data = (vectors / f"mti_rec{number}.cfg.bin").read_bytes()
    outputs = commands.decode_output_configuration(data)
    assert len(outputs) == len(data) // 4
    assert commands.encode_output_configuration(outputs)[4:-1] == data
    for identifier, _ in outputs:
        assert not commands.output_in_words(identifier).startswith("output")


def test_outputs_have_their_format_and_frame_in_words() -> None:
    assert commands.output_in_words(0x1020) == "packet counter"
    assert commands.output_in_words(0x8022) == "rate of turn, 16.32"
    assert commands.output_in_words(0xD015) == "velocity, 12.20, NED"
    assert commands.output_in_words(0xABCD) == "output ABCD"


@given(st.binary(max_size=150))
def test_no_answer_makes_a_decoder_raise(data: bytes) -> None:
    commands.decode_configuration(data)
    commands.decode_configuration(data.ljust(118, b"\xff"))
    commands.decode_scenarios(data)
    commands.decode_scenario(data)
    commands.decode_self_test(data)
    commands.decode_baudrate(data)
    for identifier, _ in commands.decode_output_configuration(data):
        assert commands.output_in_words(identifier)
