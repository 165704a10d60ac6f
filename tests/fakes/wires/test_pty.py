"""Fakes on pseudo terminals: their links, faults, hosts that come and go and set wrong speeds."""

import os
import select
import socket
import termios
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.wires.pty import PTY_BACKLOG, heard_at, maybe_speed
from fakes.wires.wire import PtyWire
from tests.support.devices.talker import Talker, until

KERNEL_KEEPS = 65536  # bytes at most, unread in a pty


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[tuple[Talker, PtyWire]]:
    fake = Talker()
    with closing(PtyWire(fake, str(tmp_path / "line"), seed=1)) as wire:
        yield fake, wire


def opened(wire: PtyWire) -> int:
    return os.open(wire.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def read_all(host: int, wire: PtyWire, size: int) -> bytes:
    received = bytearray()

    def read_on() -> None:
        wire.step(0.0)
        if select.select([host], [], [], 0.005)[0]:
            received.extend(os.read(host, 65536))

    until(lambda: len(received) >= size, read_on)
    return bytes(received)


def test_a_pty_passes_every_byte_unchanged_to_hosts_that_come_and_go(
    pty: tuple[Talker, PtyWire],
) -> None:
    fake, wire = pty
    every = bytes(range(256))
    for _ in range(3):
        host, fake.heard = opened(wire), b""
        os.write(host, every)
        until(lambda: len(fake.heard) == 256, lambda: wire.step(0.0))
        fake.says = every
        assert read_all(host, wire, 256) == every
        assert fake.heard == every  # and no echo of what was sent
        os.close(host)
        wire.step(0.0)


def test_a_pty_that_nobody_reads_never_blocks_and_keeps_little(
    pty: tuple[Talker, PtyWire],
) -> None:
    fake, wire = pty
    for _ in range(1000):
        fake.says = bytes(200)
        wire.step(0.0)
    assert wire.lost > 0
    host = opened(wire)
    kept = 1000 * 200 - wire.lost
    assert kept <= KERNEL_KEEPS + PTY_BACKLOG
    assert len(read_all(host, wire, kept)) == kept
    os.close(host)


def test_a_cut_pty_passes_nothing_either_way(pty: tuple[Talker, PtyWire]) -> None:
    fake, wire = pty
    host = opened(wire)
    wire.cut = True
    os.write(host, b"lost")
    until(lambda: select.select([wire._terminal.master], [], [], 0.0)[0], lambda: None)
    fake.says = b"lost too"
    wire.step(0.0)
    wire.cut = False
    fake.says = b"back"
    assert read_all(host, wire, 4) == b"back"
    assert fake.heard == b""
    os.close(host)


def test_a_terminal_is_found_by_its_link_which_goes_with_it_and_is_never_a_file(
    tmp_path: Path,
) -> None:
    link, precious = tmp_path / "mti", tmp_path / "precious"
    link.symlink_to("/nowhere")  # left over from a run that was killed
    with closing(PtyWire(Talker(), str(link))) as wire:
        assert wire.path == str(link)
        assert os.path.realpath(link).startswith("/dev/pts/")
    assert not os.path.lexists(link)
    precious.write_text("notes")
    with pytest.raises(FileExistsError):
        PtyWire(Talker(), str(precious))
    assert precious.read_text() == "notes"


def test_a_terminal_that_is_gone_hangs_up_and_is_back_at_its_link(
    pty: tuple[Talker, PtyWire],
) -> None:
    fake, wire = pty
    host = opened(wire)
    wire.gone = True
    fake.says = b"lost"
    wire.step(0.0)
    assert not os.path.lexists(wire.path)
    hang_up = select.poll()
    hang_up.register(host, 0)
    assert hang_up.poll(0)
    os.close(host)
    wire.step(0.5)
    wire.gone = False
    wire.step(1.0)
    host = opened(wire)
    fake.says = b"back"
    assert read_all(host, wire, 4) == b"back"
    os.write(host, b"hello")
    until(lambda: fake.heard == b"hello", lambda: wire.step(1.1))
    assert list(wire.news) == ["terminal gone", "terminal back"]
    os.close(host)


def test_faults_of_a_pty_are_those_of_every_wire(pty: tuple[Talker, PtyWire]) -> None:
    fake, wire = pty
    host = opened(wire)
    wire.alter_at, wire.drop_at, wire.host_damage_rate = {0: 1}, {2}, 1.0
    fake.says = b"ABCD"
    assert read_all(host, wire, 3) == b"@BD"
    os.write(host, bytes(50))
    until(lambda: len(fake.heard) == 50, lambda: wire.step(0.0))
    assert 0 not in fake.heard
    wire.mute = True
    fake.says = b"swallowed"
    wire.step(0.0)
    wire.mute, wire.delay_s, wire.chunk = False, 0.2, 2
    fake.says = b"late"
    wire.step(1.0)
    wire.step(1.3)
    assert os.read(host, 100) == b"la"
    wire.step(1.3)
    assert os.read(host, 100) == b"te"
    os.close(host)


class Slow(Talker):
    """A talker that says how fast its line is."""

    def __init__(self) -> None:
        super().__init__()
        self.baud = 9600


def set_speed(host: int, speed: int) -> None:
    settings = termios.tcgetattr(host)
    settings[4] = settings[5] = speed
    termios.tcsetattr(host, termios.TCSANOW, settings)


def test_a_host_at_the_wrong_speed_hears_and_says_rubbish() -> None:
    fake = Slow()
    with closing(PtyWire(fake)) as wire:
        host = opened(wire)
        fake.says = b"?Q0\r0FA\r"
        assert read_all(host, wire, 8) == b"?Q0\r0FA\r"  # a host that sets none has the right one
        set_speed(host, termios.B115200)
        wire.step(1.0)
        assert wire.news.pop() == "host at 115200 baud, device at 9600"
        fake.says = b"?Q0\r0FA\r"
        wire.step(2.0)
        rubbish = os.read(host, 1000)
        assert not set(rubbish) & set(b"?Q0\rFA")
        os.write(host, b"\r" * 20)
        until(lambda: fake.heard, lambda: wire.step(3.0))
        assert b"\r" not in fake.heard
        set_speed(host, termios.B230400)
        assert maybe_speed(host) == 230400
        set_speed(host, termios.B9600)
        fake.heard = b""
        os.write(host, b"?Q1\r")
        until(lambda: fake.heard == b"?Q1\r", lambda: wire.step(4.0))
        os.close(host)
    with socket.socket() as no_terminal:
        assert maybe_speed(no_terminal.fileno()) is None


@given(data=st.binary(max_size=40))
def test_a_faster_hearer_makes_more_of_each_character_and_a_slower_one_less(data: bytes) -> None:
    assert heard_at(data, 9600, 9600) == data
    assert len(heard_at(data, 9600, 115200)) >= len(data) >= len(heard_at(data, 115200, 9600))


def test_at_twice_the_speed_a_character_is_what_its_bits_make_it() -> None:
    # 0x55 is start 0, then 1 0 1 0 1 0 1 0, stop 1; each bit is two of the hearer's, whose start is
    # the first half of a 0, and then 0 11 00 11 0
    assert heard_at(b"\x55", 9600, 19200)[0] == 0b01100110
