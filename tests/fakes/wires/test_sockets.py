"""The wires between fakes and other processes: TCP, UDP, pty; all of them real."""

import os
import select
import socket
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial

import pytest

from fakes.wires.wire import PTY_BACKLOG, TCP_BACKLOG, PtyWire, TcpWire, UdpWire
from tests.support.talker import Talker

PATIENCE = 400  # steps of 5 ms at most, for what the kernel does in microseconds
KERNEL_KEEPS = 65536  # bytes at most, unread in a pty


def until(done: Callable[[], object], step: Callable[[], None], *readable: int) -> None:
    """Step until it is done; between steps wait up to 5 ms for what is readable."""
    for _ in range(PATIENCE):
        if done():
            return
        step()
        select.select(readable, [], [], 0.0 if done() else 0.005)
    raise AssertionError("nothing came of it")


def has_grown(count: Callable[[], int], before: int) -> bool:
    """Whether it is one more than before."""
    return count() == before + 1


@pytest.fixture
def tcp() -> Iterator[tuple[Talker, TcpWire]]:
    fake = Talker()
    with closing(TcpWire(fake)) as wire:
        yield fake, wire


def connected(wire: TcpWire) -> socket.socket:
    return socket.create_connection((wire.host, wire.port), timeout=2.0)


def test_a_tcp_client_is_served(tcp: tuple[Talker, TcpWire]) -> None:
    fake, wire = tcp
    with connected(wire) as client:
        until(lambda: wire.clients, lambda: wire.step(1.0))
        assert fake.clients == [1.0]
        client.sendall(b"hello")
        until(lambda: fake.heard == b"hello", lambda: wire.step(1.1))
        fake.says = b"world"
        wire.step(1.2)
        assert client.recv(100) == b"world"


def test_a_second_tcp_client_is_turned_away_until_the_first_has_left(
    tcp: tuple[Talker, TcpWire],
) -> None:
    fake, wire = tcp
    with connected(wire) as first:
        until(lambda: wire.clients, lambda: wire.step(0.0))
        with connected(wire) as second:
            until(lambda: wire.turned_away, lambda: wire.step(0.1))
            assert second.recv(1) == b""
        fake.says = b"still here"
        wire.step(0.2)
        assert first.recv(100) == b"still here"
    with connected(wire) as third:
        until(lambda: wire.clients == 2, lambda: wire.step(0.3))
        fake.says = b"welcome"
        wire.step(0.4)
        assert third.recv(100) == b"welcome"
    assert fake.clients == [0.0, 0.3]


def test_a_tcp_client_that_resets_the_connection_harms_nothing(
    tcp: tuple[Talker, TcpWire],
) -> None:
    fake, wire = tcp
    for visit in range(3):
        client = connected(wire)
        until(partial(has_grown, lambda: wire.clients, visit), lambda: wire.step(0.0))
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\0\0\0\0\0\0\0")
        client.close()  # a reset, not an orderly end
        for _ in range(3):
            fake.says = b"anybody there?"
            wire.step(0.0)


def test_what_a_tcp_client_is_too_slow_for_is_kept_up_to_a_bound(
    tcp: tuple[Talker, TcpWire],
) -> None:
    fake, wire = tcp
    with connected(wire) as client:
        until(lambda: wire.clients, lambda: wire.step(0.0))
        piece = bytes(range(256)) * 256
        sent = 0
        while not wire.lost and sent < 100 * TCP_BACKLOG:
            fake.says, sent = piece, sent + len(piece)
            wire.step(0.0)
        kept, received = sent - wire.lost, bytearray()
        assert wire.lost == len(piece)

        def read_on() -> None:
            wire.step(0.0)
            received.extend(client.recv(1 << 20))

        until(lambda: len(received) == kept, read_on)
        assert bytes(received) == piece * (kept // len(piece))


def test_a_cut_throws_the_tcp_client_out_and_lets_nobody_in(tcp: tuple[Talker, TcpWire]) -> None:
    _, wire = tcp
    with connected(wire) as client:
        until(lambda: wire.clients, lambda: wire.step(0.0))
        wire.cut = True
        wire.step(0.1)
        assert client.recv(1) == b""
    with connected(wire) as client:
        until(lambda: wire.turned_away, lambda: wire.step(0.2))
        assert client.recv(1) == b""
    wire.cut = False
    with connected(wire):
        until(lambda: wire.clients == 2, lambda: wire.step(0.3))


# UDP


def test_udp_answers_whoever_wrote_last() -> None:
    fake = Talker()
    with closing(UdpWire(fake)) as wire:
        fake.says_datagrams = [b"to nobody"]
        wire.step(0.0)
        for name in (b"one", b"two"):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
                client.settimeout(2.0)
                client.sendto(name, (wire.host, wire.port))
                until(partial(fake.heard_datagrams.__contains__, name), lambda: wire.step(0.0))
                fake.says_datagrams = [b"a", b"bc"]
                wire.step(0.0)
                assert [client.recv(100), client.recv(100)] == [b"a", b"bc"]
        for _ in range(3):  # the peer is gone
            fake.says_datagrams = [b"lost"]
            wire.step(0.0)


# pty


@pytest.fixture
def pty() -> Iterator[tuple[Talker, PtyWire]]:
    fake = Talker()
    with closing(PtyWire(fake)) as wire:
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


def test_a_pty_passes_every_byte_unchanged(pty: tuple[Talker, PtyWire]) -> None:
    fake, wire = pty
    every = bytes(range(256))
    host = opened(wire)
    os.write(host, every)
    until(lambda: len(fake.heard) == 256, lambda: wire.step(0.0))
    fake.says = every
    assert read_all(host, wire, 256) == every
    assert fake.heard == every  # and no echo of what was sent
    os.close(host)


def test_hosts_on_a_pty_come_and_go(pty: tuple[Talker, PtyWire]) -> None:
    fake, wire = pty
    for visit in range(3):
        host = opened(wire)
        os.write(host, b"x")
        until(partial(has_grown, lambda: len(fake.heard), visit), lambda: wire.step(0.0))
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
    until(lambda: select.select([wire._master], [], [], 0.0)[0], lambda: None)
    fake.says = b"lost too"
    wire.step(0.0)
    wire.cut = False
    fake.says = b"back"
    assert read_all(host, wire, 4) == b"back"
    assert fake.heard == b""
    os.close(host)
