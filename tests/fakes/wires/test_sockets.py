"""TCP between fakes and other processes, with its faults and its clients; all of it real."""

import select
import socket
from collections.abc import Iterator
from contextlib import closing
from functools import partial

import pytest

from fakes.wires.sockets import TCP_BACKLOG
from fakes.wires.wire import MemoryPort, TcpWire, Wire
from tests.support.devices.talker import Talker, has_grown, until


def connected(wire: TcpWire) -> socket.socket:
    return socket.create_connection((wire.host, wire.port), timeout=2.0)


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


def test_a_tcp_client_is_served_and_told_of(tcp: Tcp) -> None:
    assert tcp.fake.clients == [0.0]
    tcp.client.sendall(b"hello")
    until(lambda: tcp.fake.heard == b"hello", lambda: tcp.wire.step(1.1))
    assert tcp.hear(1.2, b"world") == b"world"
    name = "{}:{}".format(*tcp.client.getsockname())
    tcp.client.close()
    until(lambda: len(tcp.wire.news) == 2, lambda: tcp.wire.step(1.3))
    assert list(tcp.wire.news) == [f"client {name} connected", f"client {name} gone"]


def turned_away(wire: TcpWire, now_s: float) -> None:
    """One who comes now is."""
    before = wire.turned_away
    with connected(wire) as client:
        until(lambda: wire.turned_away > before, lambda: wire.step(now_s))
        assert client.recv(1) == b""


def test_a_client_is_turned_away_until_the_first_has_left_and_a_cut_throws_all_out(
    tcp: Tcp,
) -> None:
    turned_away(tcp.wire, 0.1)
    assert tcp.hear(0.2, b"still here") == b"still here"
    tcp.client.close()
    with connected(tcp.wire) as second:
        until(lambda: tcp.wire.clients == 2, lambda: tcp.wire.step(0.3))
        tcp.fake.says = b"welcome"
        tcp.wire.step(0.4)
        assert second.recv(100) == b"welcome"
        tcp.wire.cut = True
        tcp.wire.step(0.5)
        assert second.recv(1) == b""
    turned_away(tcp.wire, 0.6)
    tcp.wire.cut = False
    with connected(tcp.wire):
        until(lambda: tcp.wire.clients == 3, lambda: tcp.wire.step(0.7))
    assert tcp.fake.clients == [0.0, 0.3, 0.7]


@pytest.mark.parametrize("last_words", [b"", b"QT"])
def test_a_tcp_client_that_leaves_and_is_back_within_a_step_finds_room(
    tcp: Tcp, last_words: bytes
) -> None:
    back: list[socket.socket] = []

    class Hasty(Talker):
        """Its client acts in the middle of a step, as soon as it has heard enough."""

        def exchange(self, now_s: float, received: bytes) -> bytes:
            if not back:
                tcp.client.sendall(last_words)
                tcp.client.close()
                back.append(connected(tcp.wire))
            return super().exchange(now_s, received)

    tcp.fake.__class__ = Hasty
    until(lambda: tcp.wire.clients == 2, lambda: tcp.wire.step(1.0))
    assert (tcp.wire.turned_away, tcp.fake.heard) == (0, last_words)
    assert [news.split()[-1] for news in tcp.wire.news] == ["connected", "gone", "connected"]
    with back[0]:
        tcp.fake.says = b"welcome back"
        tcp.wire.step(1.1)
        assert back[0].recv(100) == b"welcome back"


def test_a_tcp_client_that_resets_the_connection_harms_nothing(tcp: Tcp) -> None:
    tcp.client.close()
    for visit in range(1, 4):
        client = connected(tcp.wire)
        until(partial(has_grown, lambda: tcp.wire.clients, visit), lambda: tcp.wire.step(0.0))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        client.close()  # a reset, not an orderly end
        for _ in range(3):
            tcp.fake.says = b"anybody there?"
            tcp.wire.step(0.0)


def test_what_a_tcp_client_is_too_slow_for_is_kept_up_to_a_bound(tcp: Tcp) -> None:
    piece, sent, received = bytes(range(256)) * 256, 0, bytearray()
    while not tcp.wire.lost and sent < 100 * TCP_BACKLOG:
        tcp.fake.says, sent = piece, sent + len(piece)
        tcp.wire.step(0.0)
    kept = sent - tcp.wire.lost
    assert tcp.wire.lost == len(piece)

    def read_on() -> None:
        tcp.wire.step(0.0)
        received.extend(tcp.client.recv(1 << 20))

    until(lambda: len(received) == kept, read_on)
    assert bytes(received) == piece * (kept // len(piece))


def test_faults_are_the_same_over_tcp_as_in_memory(tcp: Tcp) -> None:
    memory, port = Talker(), MemoryPort()
    wire = Wire(memory, port, 1)
    for each in (wire, tcp.wire):
        each.alter_at, each.drop_at = {1: 0x20, 6: 0x01}, {4, 7}
        each.damage_rate = 0.3
    memory.says = b"ABCDEFGHI" * 5
    wire.step(0.0)
    assert tcp.hear(0.0, b"ABCDEFGHI" * 5) == b"".join(port.read())
    tcp.wire.damage_rate, tcp.wire.delay_s, tcp.wire.host_damage_rate = 0.0, 0.5, 1.0
    assert tcp.hear(1.0, b"one ") == b""
    assert tcp.hear(1.5, b"") == b"one "
    tcp.wire.delay_s, tcp.wire.mute = 0.0, True
    assert tcp.hear(1.6, b"swallowed") == b""
    tcp.client.sendall(bytes(100))
    until(lambda: len(tcp.fake.heard) == 100, lambda: tcp.wire.step(1.7))
    assert 0 not in tcp.fake.heard
    tcp.wire.mute, tcp.wire.chunk = False, 3  # one a step
    assert [tcp.hear(2.0, says) for says in (b"abcdefg", b"", b"", b"")] == [
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
        turned_away(wire, 0.1)
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
        with connected(wire):
            until(lambda: len(fake.guests) == 3, lambda: wire.step(0.5))
        clients[1].close()


def test_a_fake_that_takes_nobody_now_turns_clients_away() -> None:
    fake = Party()
    fake.connect = lambda now_s: None  # type: ignore[assignment, method-assign, return-value]
    with closing(TcpWire(fake)) as wire:
        turned_away(wire, 0.0)
