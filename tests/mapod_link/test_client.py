"""The blocking client on real sockets and ttys, and the package's own example.

Source: planner link, section 2.
"""

import contextlib
import doctest
import os
import re
import socket
import struct
import textwrap
import threading
import tty
from collections.abc import Callable, Iterator
from functools import partial
from types import ModuleType

import pytest

import mapod_link
from mapod_link import OBSTACLE, Receiver, asking, bodies, frames, open_link
from mapod_link.client import Link
from mapod_link.frames import ACK, ASK, DRIVE, GEOM, HELLO, MAP, POSE
from mapod_link.serial_line import Deframer, serial_from_frame
from mapod_link.wires import SO_TIMESTAMPNS, SerialWire, StreamWire, UdpWire, arrival_s
from tests.support.link.planner_sender import (
    NONCE,
    SESSION,
    geom_body,
    map_body,
    op,
    pose_body,
    signed_frame,
    whole,
)

PATIENCE_S = 60.0


def frames_of_a_map(session: int = SESSION) -> list[bytes]:
    told = {GEOM: geom_body(session=session), POSE: pose_body(), MAP: map_body(op(OBSTACLE, 1))}
    return [frames.bytes_from_frame(kind, kind, 5, body) for kind, body in told.items()]


def has_map(receiver: Receiver) -> bool:
    return receiver.cell(0, 0) == OBSTACLE


def knows_map_of(session: int, receiver: Receiver) -> bool:
    return receiver.geom is not None and receiver.geom.session == session and not receiver.blank


def port_of(link: Link) -> int:
    return int(link.url.rsplit(":", 1)[1])


# Documents


@pytest.mark.parametrize("module", [mapod_link, frames, bodies])
def test_the_examples_in_the_docstrings_run(module: ModuleType) -> None:
    tried = doctest.testmod(module)
    assert tried.failed == 0
    assert tried.attempted > 0


def test_the_ten_lines_run_as_they_stand() -> None:
    lines = re.search(
        r"\n\n(    from mapod_link.*?)\n\n\*\*Without", mapod_link.__doc__ or "", re.S
    )
    assert lines is not None
    code = textwrap.dedent(lines[1]).replace("9750", "0").replace("0.1", "0.0")
    code = code.replace("while True", "for _ in [0, 1]")
    exec(compile(code, "ten lines", "exec"), {})


# UDP


@contextlib.contextmanager
def udp_sender(link: Link) -> Iterator[socket.socket]:
    """A socket that sends to the link and hears its answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.settimeout(PATIENCE_S)
        sender.connect(("127.0.0.1", port_of(link)))
        yield sender


def test_a_map_over_udp_arrives_and_is_answered() -> None:
    with open_link("udp://127.0.0.1:0", ack_every=3) as link, udp_sender(link) as sender:
        assert not link.update(0.0)
        assert link.advice() == ("stop", "no map yet")
        sender.send(b"no frame")
        for frame in frames_of_a_map():
            sender.send(frame)
        assert link.wait_for(has_map, PATIENCE_S)
        assert link.receiver.rejected == {"length": 1}
        heard = whole([sender.recv(400) for _ in range(2)])
        assert {frame.type for frame in heard} == {HELLO, ACK}
        assert link.drive(0.1, 0.0)
        while whole([sender.recv(400)])[0].type != DRIVE:
            pass
        assert not link.wait_for(lambda _: False, 0.0)
    assert link.receiver.nonce != 0


def test_datagrams_that_lay_about_are_as_old_as_they_are() -> None:
    kind, stamp = (socket.SOL_SOCKET, SO_TIMESTAMPNS), struct.pack("@ll", 1000, 500_000_000)
    assert arrival_s([(*kind, stamp)], 900.0, 99.0, 102.0) == pytest.approx(100.5)
    assert arrival_s([(*kind, stamp)], 900.0, 101.0, 102.0) == 101.0  # the wall clock was set
    assert arrival_s([(*kind, stamp)], 900.0, 99.0, 100.0) == 100.0
    assert arrival_s([(0, 0, b"")], 900.0, 99.0, 102.0) == 99.0  # not stamped: since the last look
    with contextlib.closing(UdpWire("127.0.0.1", 0)) as wire:
        assert wire._socket.getsockopt(*kind) == 1


def test_a_stranger_does_not_turn_answers_away() -> None:
    with open_link("udp://127.0.0.1:0") as link, udp_sender(link) as sender:
        for frame in frames_of_a_map():
            sender.send(frame)
        assert link.wait_for(has_map, PATIENCE_S)
        with udp_sender(link) as stranger:
            stranger.send(b"a stranger")
            assert link.wait_for(lambda known: known.rejected.total() > 0, PATIENCE_S)
            link.drive(0.1, 0.0)
            stranger.setblocking(False)
            with pytest.raises(BlockingIOError):
                stranger.recv(400)
        while whole([sender.recv(400)])[0].type != DRIVE:
            pass


def test_a_sender_that_has_no_good_frame_yet_is_greeted_all_the_same() -> None:
    with open_link("udp://127.0.0.1:0", key=bytes(32)) as link:
        for _ in range(2):  # one that goes, and one that comes from elsewhere
            with udp_sender(link) as sender:
                sender.send(signed_frame(bytes(32), 0, GEOM, 1, 5, geom_body()))
                rejected = link.receiver.rejected["tag"]
                link.wait_for(lambda known, n=rejected: known.rejected["tag"] > n, PATIENCE_S)  # type: ignore[misc]
                link.update(0.0)
                assert whole([sender.recv(400)])[0].type == HELLO


def test_answers_to_nobody_are_dropped() -> None:
    with open_link("udp://127.0.0.1:0") as link:
        with udp_sender(link) as sender:
            sender.send(frames_of_a_map()[0])
            assert link.wait_for(lambda receiver: receiver.geom is not None, PATIENCE_S)
        for _ in range(3):  # the sender is gone: the system tells us so, more than once
            link.receiver.acknowledge(link.now_s())
            link.update(0.0)


def test_a_key_and_a_url_are_checked_before_anything_opens() -> None:
    with pytest.raises(ValueError, match="32 bytes"):
        open_link("udp://127.0.0.1:0", key=b"short")
    for url in ("http://a:1", "udp://127.0.0.1", "serial://", "x"):
        with pytest.raises(ValueError, match="must be udp"):
            open_link(url)
    with pytest.raises(ValueError, match="no line here has 1234 baud"):
        open_link("serial:///dev/null?baud=1234")
    with pytest.raises(OSError, match="no serial line"):
        open_link("serial:///dev/null?baud=9600")


def test_who_only_listens_never_sends() -> None:
    with open_link("udp://127.0.0.1:0", ack_every=0) as link:
        assert not link.drive(0.1, 0.0)
        assert link.receiver.nonce == 0


def tile_of(ask: bytes) -> bytes:
    tile_id, _, layer, i, j, width, height = asking.ASK_BODY.unpack(ask)
    head = asking.ASK_BODY.pack(tile_id, layer, 0, i, j, width, height)
    count = width * height
    head += bytes(3) + bytes([7]) + count.to_bytes(2, "little") + b"\x32\x00"
    return frames.bytes_from_frame(6, 2, 6, head + b"\x55" * (count // 4))


def test_a_tile_is_waited_for() -> None:
    with open_link("udp://127.0.0.1:0", poll_only=True) as link, udp_sender(link) as sender:
        sender.send(frames_of_a_map()[0])

        def answer() -> None:
            while True:
                for frame in whole([sender.recv(400)]):
                    if frame.type == ASK:
                        sender.send(tile_of(frame.body))
                        return

        thread = threading.Thread(target=answer)
        thread.start()
        tile = link.tile("class", 3, 4, 8, 5, timeout_s=PATIENCE_S)
        thread.join()
        assert tile.complete
        assert tile.values.tolist() == [[1.0] * 8] * 5
        late = link.tile("height", 0, 0, 2, 2, timeout_s=0.0)
        assert not late.complete
        assert late.refusal == "it was dropped"


# Streams


@pytest.fixture
def pty() -> Iterator[tuple[int, str]]:
    """The far end of a serial line, and the name of the near one."""
    far, near = os.openpty()
    tty.setraw(near)
    yield far, os.ttyname(near)
    for fd in (far, near):
        with contextlib.suppress(OSError):
            os.close(fd)


def read_until(read: Callable[[], bytes], count: int) -> list[bytes]:
    """So many frames off a stream."""
    deframer = Deframer()
    got: list[bytes] = []
    while len(got) < count:
        got += [frame for frame in deframer.feed(read()) if frame is not None]
    return got


def test_a_map_over_a_serial_line_arrives_and_is_answered(pty: tuple[int, str]) -> None:
    far, path = pty
    with open_link(f"serial://{path}?baud=115200", ack_every=3) as link:
        link.update(0.0)
        stream = b"".join(map(serial_from_frame, frames_of_a_map()))
        os.write(far, stream[:40])
        link.update(0.0)
        os.write(far, stream[40:])
        assert link.wait_for(has_map, PATIENCE_S)
        heard = whole(read_until(lambda: os.read(far, 4096), 2))
        assert [frame.type for frame in heard] == [HELLO, ACK]
        assert link.url == f"serial://{path}?baud=115200"


def test_a_line_that_takes_nothing_loses_whole_frames_and_no_halves(pty: tuple[int, str]) -> None:
    far, path = pty
    wire = SerialWire(path, 115_200)
    frame = frames.bytes_from_frame(DRIVE, 1, 2, bytes(range(100)))
    for _ in range(200):
        wire.write(frame)
    os.set_blocking(far, False)
    got: list[bytes | None] = []
    deframer = Deframer()
    for _ in range(200):
        with contextlib.suppress(BlockingIOError):
            got += deframer.feed(os.read(far, 4096))
        wire.write(frame)
    assert 10 < len(got) < 400
    assert set(got) == {frame}
    wire.close()


def test_bytes_that_lay_about_are_as_old_as_the_last_look(pty: tuple[int, str]) -> None:
    far, path = pty
    with open_link(f"serial://{path}?baud=115200") as link:
        link.update(0.0)
        looked_s = link.now_s()
        os.write(far, b"".join(map(serial_from_frame, frames_of_a_map())))
        assert link.update(0.0)
        assert link.receiver.pose is not None
        assert link.receiver.pose.arrived_s <= looked_s
        assert link.receiver.advice(looked_s + 0.151) == ("stop", "link stale")


def test_a_line_that_hangs_up_is_an_error() -> None:
    end, other = os.pipe()
    wire = StreamWire(end)
    os.close(other)
    with pytest.raises(OSError, match="hung up"):
        wire.feed(Receiver(NONCE))
    wire.close()


@pytest.mark.parametrize("hangs_up", [True, False])
def test_a_map_over_tcp_arrives_and_the_newest_sender_begins_with_a_whole_frame(
    hangs_up: bool,
) -> None:
    with open_link("tcp://127.0.0.1:0", ack_every=3) as link, contextlib.ExitStack() as senders:
        link.update(0.0)
        for session in (1, 2):
            sender = socket.create_connection(("127.0.0.1", port_of(link)), PATIENCE_S)
            senders.enter_context(sender)
            stream = b"".join(map(serial_from_frame, frames_of_a_map(session)))
            sender.sendall(stream)
            sender.sendall(b"\x05half a frame")

            assert link.wait_for(partial(knows_map_of, session), PATIENCE_S)
            heard = whole(read_until(lambda of=sender: of.recv(4096), 2))  # type: ignore[misc]
            assert {frame.type for frame in heard} == {HELLO, ACK}
            if hangs_up:
                sender.close()
        assert not link.receiver.rejected
