"""The C header as a program answers on standard input and output, TCP and UDP."""

import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mapod_link.frames import Frame, frame_from_bytes
from mapod_link.serial_line import Deframer
from tests.support.link.planner_sender import VECTORS, vector
from tools.rig.planner.build import MCU, built

NAMES = ("geom", "pose", "map")
SERIAL = b"".join(vector(f"{name}_serial") for name in NAMES)
ACK, HELLO = 8, 9
GENEROUS_S = 60.0


def receiver() -> str:
    """The path of the program."""
    return str(built("receiver", MCU / "host" / "receiver.c", "-O2"))


def frames_of(line: bytes) -> list[Frame]:
    """The frames in a serial stream; all are whole."""
    pieces = Deframer().feed(line)
    frames = [frame_from_bytes(piece) for piece in pieces if piece is not None]
    assert len(frames) == len(pieces)
    return [frame for frame in frames if not isinstance(frame, str)]


def last_of(ack: Frame) -> int:
    """Number of the newest frame that an ACK tells of."""
    return int.from_bytes(ack.body[:2], "little")


def test_it_acknowledges_on_standard_output_and_ends_with_its_input() -> None:
    done = subprocess.run([receiver(), "stdio"], input=SERIAL, capture_output=True, check=True)
    frames = frames_of(done.stdout)
    assert {frame.type for frame in frames} <= {ACK, HELLO}
    assert [last_of(frame) for frame in frames if frame.type == ACK][-1] == 3


@contextmanager
def served(*words: str) -> Iterator[int]:
    """The port on which the program listens; it ends with the context."""
    with subprocess.Popen([receiver(), *words], stderr=subprocess.PIPE) as program:
        try:
            assert program.stderr is not None
            yield int(program.stderr.readline().split()[1])
        finally:
            program.kill()


def test_it_answers_whoever_sends_datagrams() -> None:
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with served("udp", "0") as port, sender:
        sender.settimeout(GENEROUS_S)
        for name in NAMES:
            sender.sendto(vector(name), ("127.0.0.1", port))
        last = 0
        while last != 3:
            frame = frame_from_bytes(sender.recv(2048))
            assert isinstance(frame, Frame)
            last = last_of(frame) if frame.type == ACK else last


def test_it_serves_one_client_after_the_other_on_tcp(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text(VECTORS["auth_key"].replace(" ", "") + "\n")
    with served("tcp", "0", str(key)) as port:
        for _ in range(2):
            with socket.create_connection(("127.0.0.1", port), GENEROUS_S) as client:
                client.sendall(SERIAL)
                heard = b""
                while b"\0" not in heard:
                    heard += client.recv(64)
                assert frames_of(heard[: heard.index(0) + 1])[0].type == HELLO


@pytest.mark.parametrize(
    "words", [[], ["serial"], ["udp"], ["udp", "0", "/nowhere"], ["stdio", "x", "y"]]
)
def test_wrong_words_are_refused(words: list[str]) -> None:
    done = subprocess.run([receiver(), *words], capture_output=True, check=False)
    assert done.returncode == 2
    assert done.stderr
