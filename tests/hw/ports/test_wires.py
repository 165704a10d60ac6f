"""Ports on real loopback sockets and ptys. Time is simulated; only bytes are waited for."""

import contextlib
import os
import select
import socket
import termios
import tty
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path

import pytest

from hw.device import Port
from hw.ports import wires as ports
from hw.ports.reopening import BACKLOG, READ_SIZE, RETRY_FIRST_S, describe_loss
from hw.ports.wires import PortUrlError, open_port

START_S = 100.0


def until(done: Callable[[], object]) -> None:
    """Give the kernel up to a few seconds to bring it about."""
    for _ in range(2000):
        if done():
            return
        select.select([], [], [], 0.001)
    raise AssertionError("it did not come about")


def read_all(port: Port, size: int) -> bytes:
    """The next `size` bytes of a port."""
    data = bytearray()

    def enough() -> bool:
        data.extend(b"".join(port.read()))
        return len(data) >= size

    until(enough)
    return bytes(data)


def is_lost(port: Port, now_s: float) -> bool:
    return not port.read() and not port.poll(now_s)


@pytest.fixture
def listener() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(3)
        yield server


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    """The device's end, which never waits, and the path of the host's."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    yield master, os.ttyname(slave)
    os.close(slave)
    with contextlib.suppress(OSError):  # a test may have closed it
        os.close(master)


def tcp_port(listener: socket.socket) -> Port:
    return open_port(f"tcp://127.0.0.1:{listener.getsockname()[1]}")


def connected(listener: socket.socket, port: Port) -> socket.socket:
    until(lambda: port.poll(START_S))
    client = listener.accept()[0]
    client.settimeout(3)
    return client


# --- TCP


def test_a_tcp_port_opens_writes_and_reads_without_blocking(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port:
        assert (port.opened, port.cause, port.datagrams) == (0, "not opened yet", False)
        with connected(listener, port) as device:
            assert (port.opened, port.cause) == (1, "")
            assert port.read() == []
            port.write(b"sRN STlms")
            assert device.recv(100) == b"sRN STlms"
            assert port.backlog == 0
            device.sendall(b"answer")
            assert read_all(port, 6) == b"answer"


def test_bytes_written_before_it_is_open_are_dropped(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port:
        port.write(b"too early")
        with connected(listener, port) as device:
            port.write(b"now")
            assert device.recv(100) == b"now"


def refused(port: Port, now_s: float) -> bool:
    return not port.poll(now_s) and port.cause.startswith("connection refused")


def test_a_refused_connection_is_tried_again_with_growing_pauses() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = server.getsockname()
    with contextlib.closing(open_port(f"tcp://127.0.0.1:{address[1]}")) as port:
        assert isinstance(port, ports.TcpPort)
        tries, last = [], 0.0
        for tick in range(2000):  # 20 s
            now_s = START_S + tick * 0.01
            until(partial(refused, port, now_s))
            if port._retry_s != last:
                last = port._retry_s
                tries.append(now_s)
        assert port.cause == f"connection refused by 127.0.0.1:{address[1]}"
        assert len(tries) > 30
        pauses_s = [later - sooner for sooner, later in pairwise(tries)]
        assert pauses_s == pytest.approx([0.2, 0.4, *[0.5] * (len(tries) - 3)], abs=0.011)


def test_a_peer_that_does_not_answer_is_given_up_after_the_connect_time() -> None:
    with socket.socket() as full:  # a full queue of newcomers: the kernel drops what comes then
        full.bind(("127.0.0.1", 0))
        full.listen(0)
        address = full.getsockname()
        waiting = [socket.socket() for _ in range(4)]
        for one in waiting:
            one.setblocking(False)
            one.connect_ex(address)
        with contextlib.closing(open_port(f"tcp://127.0.0.1:{address[1]}")) as port:
            for _ in range(5):
                assert not port.poll(START_S)
            assert port.cause == f"connecting to 127.0.0.1:{address[1]}"
            assert not port.poll(START_S + ports.CONNECT_S - 0.01)
            assert not port.poll(START_S + ports.CONNECT_S)
            assert port.cause == f"no answer from 127.0.0.1:{address[1]}"
        for one in waiting:
            one.close()


def test_a_lost_connection_is_named_and_opened_again_after_the_pause(
    listener: socket.socket,
) -> None:
    with contextlib.closing(tcp_port(listener)) as port:
        where = f"127.0.0.1:{listener.getsockname()[1]}"
        with connected(listener, port) as device:
            device.sendall(b"last words")
        assert read_all(port, 10) == b"last words"
        until(partial(is_lost, port, START_S))
        assert port.cause == f"connection closed by {where}"
        assert not port.poll(START_S + RETRY_FIRST_S - 0.01)
        until(lambda: port.poll(START_S + RETRY_FIRST_S))
        assert (port.opened, port.cause) == (2, "")


def test_a_reset_connection_is_a_loss_too(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port:
        device = connected(listener, port)
        port.write(b"unread")
        until(lambda: select.select([device], [], [], 0)[0])
        device.close()  # with bytes unread: a reset
        until(partial(is_lost, port, START_S))
        assert port.cause.startswith("connection reset by")


def test_connections_that_bring_no_bytes_make_the_pauses_grow(listener: socket.socket) -> None:
    now_s = START_S
    with contextlib.closing(tcp_port(listener)) as port:
        for pause_s in (0.2, 0.4, 0.8):
            until(partial(port.poll, now_s))
            listener.accept()[0].close()
            until(partial(is_lost, port, now_s))
            assert not port.poll(now_s + pause_s - 0.01)
            now_s += pause_s
        until(partial(port.poll, now_s))


def test_connections_that_bring_bytes_are_opened_again_soon(listener: socket.socket) -> None:
    now_s = START_S
    with contextlib.closing(tcp_port(listener)) as port:
        for _ in range(4):
            until(partial(port.poll, now_s))
            with listener.accept()[0] as device:
                device.sendall(b"x")
            assert read_all(port, 1) == b"x"
            until(partial(is_lost, port, now_s))
            now_s += RETRY_FIRST_S + 1e-6
        until(partial(port.poll, now_s))


def test_a_peer_that_takes_no_bytes_is_dropped_and_nothing_waits(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port, connected(listener, port):
        for _ in range(100_000):
            port.write(bytes(4096))
            assert port.backlog <= BACKLOG
            if not port.poll(START_S):
                break
        assert port.cause.endswith("is not taking bytes")
        assert port.backlog == 0


def test_what_the_wire_did_not_take_at_once_follows_in_order(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port, connected(listener, port) as device:
        sent = bytearray()
        while not port.backlog:
            piece = len(sent).to_bytes(4, "big") * 512
            port.write(piece)
            sent += piece
        received = bytearray()
        while len(received) < len(sent):
            received += device.recv(1 << 20)
            assert port.poll(START_S)
        assert received == sent
        assert port.backlog == 0


def test_one_read_is_bounded(listener: socket.socket) -> None:
    with contextlib.closing(tcp_port(listener)) as port, connected(listener, port) as device:
        device.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while device.send(bytes(100_000)):
                pass
        assert 0 < sum(map(len, port.read())) <= READ_SIZE


def test_a_closed_port_stays_closed(listener: socket.socket) -> None:
    port = tcp_port(listener)
    with connected(listener, port) as device:
        port.close()
        assert device.recv(10) == b""
    assert not port.poll(START_S + 1000)
    port.write(b"nothing")
    port.close()
    assert (port.read(), port.cause) == ([], "closed")


# --- UDP


def test_datagrams_stay_whole_both_ways() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        planner.settimeout(3)
        url = f"udp://127.0.0.1:{planner.getsockname()[1]}"
        with contextlib.closing(open_port(url)) as port:
            assert port.poll(START_S)
            assert port.datagrams
            port.write(b"one")
            port.write(b"two")
            datagram, host = planner.recvfrom(100)
            assert (datagram, planner.recv(100)) == (b"one", b"two")
            planner.sendto(b"a" * ports.DATAGRAM_SIZE, host)
            planner.sendto(b"b", host)
            pieces: list[bytes] = []
            for _ in range(1000):  # loopback delivers at once
                pieces += port.read()
            assert pieces == [b"a" * ports.DATAGRAM_SIZE, b"b"]
            assert port.backlog == 0


def test_a_peer_that_is_not_there_does_not_close_udp_and_misses_only_what_it_missed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        address = planner.getsockname()
    with contextlib.closing(open_port(f"udp://127.0.0.1:{address[1]}")) as port:
        assert isinstance(port, ports.UdpPort)
        assert port.poll(START_S)
        for _ in range(5):
            port.write(b"is anybody there")
            port.read()
        assert port.poll(START_S)
        assert port.refused > 0
        port.write(b"last unheard")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
            planner.bind(address)
            planner.settimeout(3)
            port.write(b"first heard")
            assert planner.recv(100) == b"first heard"
        assert (port.opened, port.unsent) == (1, 0)


def test_a_datagram_beyond_what_udp_carries_is_counted_and_lost() -> None:
    with contextlib.closing(open_port("udp://127.0.0.1:9")) as port:
        assert isinstance(port, ports.UdpPort)
        assert port.poll(START_S)
        port.write(bytes(70_000))
        assert port.unsent == 1
        assert port.poll(START_S)


# --- serial


def test_a_pty_carries_all_bytes_both_ways(pty: tuple[int, str]) -> None:
    master, path = pty
    with contextlib.closing(open_port(f"serial://{path}?baud=115200")) as port:
        assert port.poll(START_S)
        assert port.read() == []
        everything = bytes(range(256))
        port.write(everything)
        until(lambda: select.select([master], [], [], 0)[0])
        assert os.read(master, 1000) == everything
        os.write(master, everything)
        assert read_all(port, 256) == everything


def test_a_pty_asked_for_seven_bits_and_parity_opens_again_and_again(pty: tuple[int, str]) -> None:
    for _ in range(3):
        url = f"serial://{pty[1]}?baud=9600&parity=E&bytesize=7"
        with contextlib.closing(open_port(url)) as port:
            assert port.poll(START_S), port.cause


def test_a_pty_is_recognised_through_a_link(pty: tuple[int, str], tmp_path: Path) -> None:
    link = str(tmp_path / "ax3500")
    os.symlink(pty[1], link)
    for _ in range(2):
        url = f"serial://{link}?baud=9600&parity=E&bytesize=7"
        with contextlib.closing(open_port(url)) as port:
            assert port.poll(START_S), port.cause


def test_a_full_line_waits_for_nothing_then_is_given_up_and_closes_at_once(
    pty: tuple[int, str],
) -> None:
    with contextlib.closing(open_port(f"serial://{pty[1]}?baud=9600")) as port:
        assert port.poll(START_S)
        port.write(bytes(60_000))
        assert 0 < port.backlog < 60_000
        for _ in range(100):  # a kernel takes some thousand bytes, not always as many
            if not port.poll(START_S):
                break
            port.write(bytes(10_000))
            assert port.backlog <= BACKLOG
        assert port.cause == f"{pty[1]} is not taking bytes"


def test_a_line_whose_device_is_gone_is_closed_and_named(pty: tuple[int, str]) -> None:
    master, path = pty
    with contextlib.closing(open_port(f"serial://{path}?baud=9600")) as port:
        assert port.poll(START_S)
        os.write(master, b"last words")
        assert read_all(port, 10) == b"last words"
        os.close(master)
        until(partial(is_lost, port, START_S))
        assert port.cause == f"{path} is gone"


def test_a_device_that_is_not_there_yet_is_opened_when_it_comes(
    pty: tuple[int, str], tmp_path: Path
) -> None:
    path = str(tmp_path / "mti")
    with contextlib.closing(open_port(f"serial://{path}?baud=115200")) as port:
        assert not port.poll(START_S)
        assert port.cause == f"no such device {path}"
        os.symlink(pty[1], path)
        assert not port.poll(START_S + 0.1)
        assert port.poll(START_S + 0.2)
        assert (port.opened, port.cause) == (1, "")


def test_a_file_that_is_no_line_and_a_line_in_use_are_named(
    pty: tuple[int, str], tmp_path: Path
) -> None:
    path = str(tmp_path / "file")
    (tmp_path / "file").touch()
    with contextlib.closing(open_port(f"serial://{path}?baud=9600")) as port:
        assert not port.poll(START_S)
        assert path in port.cause
        assert "ioctl" in port.cause or "not a serial line" in port.cause
    url = f"serial://{pty[1]}?baud=9600"
    with contextlib.closing(open_port(url)) as one, contextlib.closing(open_port(url)) as two:
        assert one.poll(START_S)
        assert not two.poll(START_S)
        assert two.cause == f"{pty[1]} is in use by another program"


def test_what_the_line_says_of_a_setting_is_told_with_its_name() -> None:
    for error in (termios.error(22, "Invalid argument"), ValueError("Failed to set custom baud")):
        assert describe_loss(error, "/dev/mti").startswith("/dev/mti: ")


def test_a_host_without_an_address_is_an_error_before_the_loop_runs() -> None:
    with pytest.raises(PortUrlError, match="has no known address"):
        open_port(f"tcp://{'x' * 70}.invalid:1")


def test_a_number_is_not_looked_up() -> None:
    with contextlib.closing(open_port("udp://[::1]:9750")) as port:
        assert port.cause == "not opened yet"
