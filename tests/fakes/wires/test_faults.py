"""Faults on the wires that other programs reach: TCP and ptys; wrong speeds; several clients."""

import os
import select
import socket
import termios
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes.wires.baud import heard_at, maybe_speed
from fakes.wires.wire import MemoryPort, PtyWire, TcpWire, Wire
from tests.fakes.wires.test_sockets import connected, opened, read_all, until
from tests.support.talker import Talker

SPEEDS = st.sampled_from([4800, 9600, 19200, 38400, 57600, 115200, 230400, 921600])


class Tcp:
    """A talker on TCP and one client of it, in."""

    def __init__(self, wire: TcpWire, fake: Talker) -> None:
        self.wire, self.fake = wire, fake
        self.client = connected(wire)
        until(lambda: wire.clients, lambda: wire.step(0.0))

    def hear(self, now_s: float, says: bytes) -> bytes:
        """What the client gets of it by this step."""
        self.fake.says = says
        self.wire.step(now_s)
        ready = select.select([self.client], [], [], 0.02)[0]
        return self.client.recv(65536) if ready else b""


@pytest.fixture
def tcp() -> Iterator[Tcp]:
    fake = Talker()
    with closing(TcpWire(fake, seed=1)) as wire:
        tcp = Tcp(wire, fake)
        with tcp.client:
            yield tcp


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[tuple[Talker, PtyWire]]:
    fake = Talker()
    with closing(PtyWire(fake, str(tmp_path / "line"), seed=1)) as wire:
        yield fake, wire


# TCP


def test_faults_at_given_offsets_are_the_same_over_tcp_as_in_memory(tcp: Tcp) -> None:
    memory, port = Talker(), MemoryPort()
    wire = Wire(memory, port, 1)
    for each in (wire, tcp.wire):
        each.alter_at, each.drop_at = {1: 0x20, 6: 0x01}, {4, 7}
        each.damage_rate = 0.3
    memory.says = b"ABCDEFGHI" * 5
    wire.step(0.0)
    assert tcp.hear(0.0, b"ABCDEFGHI" * 5) == b"".join(port.read())


def test_a_mute_wire_over_tcp_still_hears(tcp: Tcp) -> None:
    tcp.wire.mute = True
    tcp.client.sendall(b"hello?")
    until(lambda: tcp.fake.heard == b"hello?", lambda: tcp.wire.step(0.1))
    assert tcp.hear(0.2, b"swallowed") == b""
    tcp.wire.mute = False
    assert tcp.hear(0.3, b"back") == b"back"


def test_bytes_over_tcp_come_late_and_in_order(tcp: Tcp) -> None:
    tcp.wire.delay_s = 0.5
    assert tcp.hear(1.0, b"one ") == b""
    tcp.wire.delay_s = 0.0
    assert tcp.hear(1.1, b"two ") == b""
    assert tcp.hear(1.5, b"three") == b"one two three"


def test_the_way_to_the_device_over_tcp_has_its_own_faults(tcp: Tcp) -> None:
    tcp.wire.host_damage_rate = 1.0
    tcp.client.sendall(bytes(100))
    until(lambda: len(tcp.fake.heard) == 100, lambda: tcp.wire.step(0.1))
    assert 0 not in tcp.fake.heard


def test_chunks_over_tcp_come_one_a_step(tcp: Tcp) -> None:
    tcp.wire.chunk = 3
    assert [tcp.hear(0.1 * k, b"abcdefg" if k == 0 else b"") for k in range(4)] == [
        *(b"abc", b"def", b"g", b"")
    ]


def test_a_pulled_network_cable_is_silence_and_no_end(tcp: Tcp) -> None:
    tcp.wire.unplugged = True
    tcp.client.sendall(b"anybody?")
    assert tcp.hear(1.0, b"under way") == b""
    late = connected(tcp.wire)  # the system answers; the device does not
    tcp.wire.step(2.0)
    assert (tcp.fake.heard, tcp.wire.clients, tcp.wire.turned_away) == (b"", 1, 0)
    tcp.wire.unplugged = False
    assert tcp.hear(3.0, b", arrived") == b"under way, arrived"
    until(lambda: tcp.fake.heard == b"anybody?", lambda: tcp.wire.step(3.1))
    until(lambda: tcp.wire.turned_away, lambda: tcp.wire.step(3.2))
    late.close()


def test_the_wire_tells_who_came_and_who_went(tcp: Tcp) -> None:
    name = "{}:{}".format(*tcp.client.getsockname())
    tcp.client.close()
    until(lambda: len(tcp.wire.news) == 2, lambda: tcp.wire.step(0.1))
    assert list(tcp.wire.news) == [f"client {name} connected", f"client {name} gone"]


class Party(Talker):
    """A fake that holds an object for each client."""

    def __init__(self) -> None:
        super().__init__()
        self.max_clients = 2
        self.guests: list[Talker] = []
        self.gone: list[float] = []

    def connect(self, now_s: float) -> Talker:
        guest = Talker()
        guest.left = self.gone.append  # type: ignore[attr-defined]
        self.guests.append(guest)
        return guest


def test_a_fake_of_several_clients_has_an_object_for_each() -> None:
    fake = Party()
    with closing(TcpWire(fake)) as wire:
        clients = [connected(wire) for _ in range(2)]
        until(lambda: wire.clients == 2, lambda: wire.step(0.0))
        third = connected(wire)
        until(lambda: wire.turned_away, lambda: wire.step(0.1))
        assert third.recv(1) == b""
        for client, guest, word in zip(clients, fake.guests, (b"one", b"two"), strict=True):
            client.sendall(word)
            until(partial(guest.heard.__eq__, b""), lambda: wire.step(0.2))
            guest.says = word.upper()
        until(
            lambda: [guest.heard for guest in fake.guests] == [b"one", b"two"],
            lambda: wire.step(0.3),
        )
        assert [client.recv(10) for client in clients] == [b"ONE", b"TWO"]
        clients[0].close()
        until(lambda: fake.gone == [0.4], lambda: wire.step(0.4))
        third.close()
        with connected(wire):
            until(lambda: len(fake.guests) == 3, lambda: wire.step(0.5))
        clients[1].close()


def test_a_fake_that_takes_nobody_now_turns_clients_away() -> None:
    fake = Party()
    fake.connect = lambda now_s: None  # type: ignore[assignment, method-assign, return-value]
    with closing(TcpWire(fake)) as wire, connected(wire) as client:
        until(lambda: wire.turned_away, lambda: wire.step(0.0))
        assert client.recv(1) == b""


def test_all_that_a_device_sends_in_a_step_goes_out_in_one_piece(tcp: Tcp) -> None:
    answer = bytes(range(256)) * 8
    for _ in range(10):
        assert tcp.hear(0.0, answer) == answer


# pty


def set_speed(host: int, speed: int) -> None:
    """As a host sets it."""
    settings = termios.tcgetattr(host)
    settings[4] = settings[5] = speed
    termios.tcsetattr(host, termios.TCSANOW, settings)


def test_a_terminal_is_found_by_its_link_which_goes_with_it(tmp_path: Path) -> None:
    link = tmp_path / "mti"
    link.symlink_to("/nowhere")  # left over from a run that was killed
    with closing(PtyWire(Talker(), str(link))) as wire:
        assert wire.path == str(link)
        assert os.path.realpath(link).startswith("/dev/pts/")
    assert not os.path.lexists(link)


def test_a_file_in_the_links_place_is_left_alone(tmp_path: Path) -> None:
    precious = tmp_path / "precious"
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
        set_speed(host, termios.B9600)
        fake.heard = b""
        os.write(host, b"?Q1\r")
        until(lambda: fake.heard == b"?Q1\r", lambda: wire.step(4.0))
        os.close(host)


def test_the_speed_of_a_terminal_is_told_whatever_it_is() -> None:
    with closing(PtyWire(Slow())) as wire:
        host = opened(wire)
        assert maybe_speed(host) == 9600
        for name in (4800, 57600, 230400, 921600):
            set_speed(host, getattr(termios, f"B{name}"))
            assert maybe_speed(host) == name
        os.close(host)
    with socket.socket() as no_terminal:
        assert maybe_speed(no_terminal.fileno()) is None


@given(data=st.binary(max_size=40), sent=SPEEDS, heard=SPEEDS)
def test_rubbish_is_the_same_each_time_and_about_as_long_as_the_line_was_busy(
    data: bytes, sent: int, heard: int
) -> None:
    rubbish = heard_at(data, sent, heard)
    assert rubbish == heard_at(data, sent, heard)
    if sent == heard:
        assert rubbish == data
    else:
        assert len(rubbish) <= min(5 * len(data), 1 + 1.2 * len(data) * heard / sent)
        assert bool(rubbish) == bool(data)


def test_at_twice_the_speed_a_character_is_what_its_bits_make_it() -> None:
    # 0x55 at 9600: start 0, then 1 0 1 0 1 0 1 0, stop 1; each bit is two of the hearer's bits,
    # whose start is the first half of a 0 and whose bits are 0 11 00 11 0, then the stop's 0 is bad
    assert heard_at(b"\x55", 9600, 19200)[0] == 0b01100110
