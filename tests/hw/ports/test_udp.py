"""UDP ports on real loopback sockets."""

import contextlib
import socket

from hw.ports.sockets import DATAGRAM_SIZE, UdpPort
from hw.ports.wires import open_port
from tests.support.machine.real_wires import START_S


def test_datagrams_stay_whole_both_ways() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        planner.settimeout(30)
        url = f"udp://127.0.0.1:{planner.getsockname()[1]}"
        with contextlib.closing(open_port(url)) as port:
            assert port.fileno() == -1
            assert port.poll(START_S)
            assert port.datagrams
            assert port.fileno() >= 0
            port.write(b"one")
            port.write(b"two")
            datagram, host = planner.recvfrom(100)
            assert (datagram, planner.recv(100)) == (b"one", b"two")
            planner.sendto(b"a" * DATAGRAM_SIZE, host)
            planner.sendto(b"b", host)
            pieces: list[bytes] = []
            for _ in range(1000):  # loopback delivers at once
                pieces += port.read()
            assert pieces == [b"a" * DATAGRAM_SIZE, b"b"]
            assert port.backlog == 0


def test_a_peer_that_is_not_there_does_not_close_udp_and_misses_only_what_it_missed() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
        planner.bind(("127.0.0.1", 0))
        address = planner.getsockname()
    with contextlib.closing(open_port(f"udp://127.0.0.1:{address[1]}")) as port:
        assert isinstance(port, UdpPort)
        assert port.poll(START_S)
        for _ in range(5):
            port.write(b"is anybody there")
            port.read()
        port.write(bytes(70_000))  # more than a datagram carries: lost
        assert port.poll(START_S)
        port.write(b"last unheard")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as planner:
            planner.bind(address)
            planner.settimeout(30)
            port.write(b"first heard")
            assert planner.recv(100) == b"first heard"
        assert port.opened == 1
