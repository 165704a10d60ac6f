"""Fingerprints: what is known is named, the right device never is, chance is not believed."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.fingerprint import (
    KEPT,
    NAMES,
    OWN,
    SEEMS,
    SENT_KEPT,
    Fingerprint,
    is_echo,
    is_noise,
    maybe_protocol,
)
from tests import VECTORS

SSH, MT = b"SSH-2.0-OpenSSH_9.2p1 Debian-2\r\n", bytes.fromhex("FA FF 3E 00 C3")
EXAMPLES = [
    ("nmea", b"\r\n$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"),
    ("http", b"HTTP/1.1 400 Bad Request\r\nServer: lighttpd\r\n\r\n"),
    ("ssh", SSH),
    ("console", b"\r\nDebian GNU/Linux 12 robot ttyS0\r\n\r\nrobot login: "),
    ("scip", b"VV\n00P\nVEND:Hokuyo Automatic Co.,Ltd.;[\n"),
    ("scip", b"SCIP2.0\n0\n\n"),
    ("roboteq", b"Roboteq v1.9b 06/01/07\rs\r"),
    ("roboteq", b":0000000000FE00009898396AB7B70000\r"),  # R/C mode
    ("roboteq", b"?E\r00\r7F\r"),
    ("roboteq", b"^00\r01\r"),
    ("cola-a", b"\x02sRA SCdevicestate 1\x03"),
    ("cola-b", b"\x02\x02\x02\x02\x00\x00\x00\x05sFA\x00\x03\x68"),
    ("mt", MT),
]
NOTHING = [
    b"$GPGGA,123519,4807.038,N*00\r\n",  # a wrong checksum
    b"00P",
    bytes.fromhex("FA FF 3E 00 C4"),  # a wrong checksum
    bytes.fromhex("FA FF 32 10 00 00"),  # its end is missing
    bytes.fromhex("FA FF 32 FF FF FF 00"),  # longer than any
]
NOISE = bytes([0x00, 0x80, 0xF8, 0x1C]) * 100
RECORDINGS = {
    "lms111_session_d2h.bin": "lms111",
    "tim781_1s_d2h.bin": "lms111",
    "mrs1000_cola_a_one_scan.bin": "lms111",
    **{f"mti_rec{n}.bin": "mti" for n in range(1, 6)},
}


@pytest.mark.parametrize(("key", "data"), EXAMPLES)
def test_a_protocol_is_known_by_a_few_of_its_bytes(key: str, data: bytes) -> None:
    assert maybe_protocol(data) == key
    assert maybe_protocol(b"\x80\x00" + data + b"\xff\x80") == key
    assert NAMES[key]


def test_a_likeness_is_not_enough() -> None:
    assert [maybe_protocol(data) for data in NOTHING] == [None] * len(NOTHING)


@pytest.mark.parametrize("name", ["geom", "pose", "map", "ack", "map_auth"])
def test_the_planner_link_is_known_in_both_forms(name: str) -> None:
    examples = json.loads((VECTORS / "planner_link.json").read_text(encoding="utf-8"))
    frame = bytes.fromhex(examples[name])
    assert maybe_protocol(frame) == "planner-link"
    if on_serial := examples.get(f"{name}_serial"):
        assert maybe_protocol(b"rest of one\x00" + bytes.fromhex(on_serial)) == "planner-link"
    assert maybe_protocol(frame[:-1] + bytes([frame[-1] ^ 1])) is None


@pytest.mark.parametrize(("name", "device"), RECORDINGS.items(), ids=RECORDINGS.keys())
def test_the_right_device_is_never_named_as_another(name: str, device: str) -> None:
    data = (VECTORS / name).read_bytes()
    random, fingerprint = np.random.default_rng(1), Fingerprint(device)
    for _ in range(60):
        begin, size = int(random.integers(len(data))), int(random.integers(1, 2 * KEPT))
        found = maybe_protocol(data[begin : begin + size])
        assert found is None or found in OWN[device], (begin, size)
    for at in range(7, len(data), 100):  # nor as noise
        assert fingerprint.message(at * 1e-3, [data[at : at + 100]], b"") == ""


@pytest.mark.parametrize(
    ("name", "other"), [("mti_rec1.bin", "ax3500"), ("lms111_session_d2h.bin", "mti")]
)
def test_a_recording_on_the_wrong_port_is_named(name: str, other: str) -> None:
    fingerprint, message = Fingerprint(other), ""
    data = (VECTORS / name).read_bytes()
    for at in range(0, 4 * KEPT, 64):
        message = fingerprint.message(at / 64 * 0.01, [data[at : at + 64]], b"")
    assert message.startswith(SEEMS)
    assert ("MTi" in message) is (other == "ax3500")


def test_random_bytes_are_nearly_never_believed() -> None:
    random = np.random.default_rng(2)
    names = [maybe_protocol(random.bytes(KEPT)) for _ in range(300)]
    assert sum(name is not None for name in names) <= 1


@given(st.binary(max_size=600))
def test_no_bytes_make_it_raise(data: bytes) -> None:
    maybe_protocol(data)
    is_noise(data)
    is_echo(data, data)


def test_an_echo_needs_enough_bytes_all_of_which_were_sent() -> None:
    sent = b"\xfa\xff\x30\x00\xd1" * 4
    assert is_echo(sent[:10], sent)
    assert not is_echo(sent[:5], sent)
    assert not is_echo(b"\xfa\xff\x31\x00\xd0" * 2, sent)
    controller = Fingerprint("ax3500")  # which echoes
    controller.message(0.0, [], b"?Q0\r?Q1\r")
    assert controller.message(1.0, [b"?Q0\r?Q1\r"], b"") == ""


def test_noise_is_many_bytes_that_are_no_text_and_no_protocol() -> None:
    assert is_noise(NOISE)
    assert not is_noise(NOISE[:200])
    assert not is_noise(b"some text that a person might read " * 20)
    assert not is_noise(NOISE + MT)


@pytest.mark.parametrize(
    ("device", "is_told"), [("mti", True), ("ax3500", True), ("lms111", False)]
)
def test_a_wrong_baud_rate_is_thought_of_on_serial_lines_only(device: str, is_told: bool) -> None:
    message = Fingerprint(device).message(1.0, [NOISE], b"")
    assert ("wrong baud rate" in message) is is_told


def test_what_comes_in_crumbs_is_remembered_until_forgotten_or_the_device_speaks() -> None:
    fingerprint = Fingerprint("mti")
    for at in range(len(SSH)):
        message = fingerprint.message(at * 0.02, [SSH[at : at + 1]], b"")
    assert message == f"{SEEMS}an SSH server"
    assert fingerprint.message(100.0, [], b"") == message
    fingerprint.forget()
    assert fingerprint.message(100.1, [], b"") == ""
    assert fingerprint.message(100.2, [SSH], b"") != ""
    fingerprint.message(100.4, [bytes(KEPT)], b"")
    assert fingerprint.message(100.6, [MT], b"") == ""


def test_memory_is_bounded_whatever_comes() -> None:
    fingerprint = Fingerprint("mti")
    for tick in range(2000):
        fingerprint.message(tick * 1e-5, [bytes(65536)], bytes(65536))
    assert len(fingerprint._heard) <= KEPT
    assert len(fingerprint._sent) <= SENT_KEPT
