"""The check of somebody else's receiver, over real ports: what it says, and its exit status."""

import socket
from pathlib import Path

import pytest

from mapod_link.receiver import Receiver
from tests import Capsys, Patch
from tests.support.cases import few
from tests.support.link.served_receiver import ServedReceiver
from tests.support.link.wrong_receivers import WRONG
from tools.cli import link_test
from tools.conformance.slow_receiver import SlowReceiver
from tools.conformance.suite import chosen

pytestmark = pytest.mark.slow

KEY = bytes(range(32))
SOON_S = 0.01  # between two ACKs: nobody has to wait long


def outcome(url: str, only: str, *more: str) -> int:
    return link_test.main(["--port", url, "--only", only, "--seconds", "1", *more])


@pytest.mark.parametrize(
    ("datagrams", "only"), few([(True, "1"), (True, "1,2,15"), (False, "1,2,15")], 1)
)
def test_a_right_receiver_passes(datagrams: bool, only: str, capsys: Capsys) -> None:
    with ServedReceiver(Receiver(77, max_cells=10_201, ack_period_s=SOON_S), datagrams) as served:
        assert outcome(served.url, only, "--strict") == link_test.PASSED
    said = capsys.readouterr().out
    assert "takes 10201 cells, frames of 368 bytes" in said
    assert "0 failed" in said
    assert ("datagrams are not COBS-encoded" in said) == datagrams


@pytest.mark.slow
def test_a_receiver_with_a_key_passes_with_it(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "key"
    path.write_text(KEY.hex() + "\n")
    path.chmod(0o600)
    with ServedReceiver(Receiver(0x11223344, key=KEY, ack_period_s=SOON_S)) as served:
        assert outcome(served.url, "1,4", "--key-file", str(path)) == link_test.PASSED
    assert "session that was left" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name", few(["rejected frame half applied", "repaired is ignored", "no CRC"], 1)
)
def test_a_wrong_receiver_fails_and_its_frames_are_told(name: str, capsys: Capsys) -> None:
    number, kind = WRONG[name]
    kind.ack_period_s = SOON_S
    with ServedReceiver(kind(nonce=5)) as served:
        assert outcome(served.url, number) == link_test.FAILED
    said = capsys.readouterr().out
    assert "first failure" in said
    assert "expected" in said
    newest = said.strip().splitlines()[-1].split()
    assert all(len(byte) == 2 and int(byte, 16) >= 0 for byte in newest)


class _Silent(SlowReceiver):
    """Says HELLO, takes the geometry, and acknowledges nothing."""

    def _acknowledge(self, now_s: float) -> None:
        """Nothing."""


@pytest.mark.slow
def test_a_receiver_without_acks_cannot_be_examined(capsys: Capsys) -> None:
    with ServedReceiver(_Silent(nonce=5)) as served:
        assert outcome(served.url, "2") == link_test.NOT_EXAMINED
    assert "sends no ACK" in capsys.readouterr().out


class _NoDigest(SlowReceiver):
    """A small one: compares no DIGEST."""

    def compare(self, body: bytes) -> None:
        """Counted, and no more."""


def test_without_digests_the_map_is_not_said_to_be_right(capsys: Capsys) -> None:
    with ServedReceiver(_NoDigest(nonce=5)) as served:
        assert outcome(served.url, "2") == link_test.NOT_EXAMINED
    said = capsys.readouterr().out
    assert "compares no DIGEST" in said
    assert "0 passed, 0 failed, 4 skipped" in said


def test_where_nobody_answers_nothing_passes(monkeypatch: Patch, capsys: Capsys) -> None:
    monkeypatch.setattr(link_test, "CONTACT_S", 0.2)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as deaf:
        deaf.bind(("127.0.0.1", 0))
        url = f"udp://127.0.0.1:{deaf.getsockname()[1]}"
        assert outcome(url, "2") == link_test.NOT_EXAMINED
    assert "no HELLO came and no ACK" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--port", "udp://127.0.0.1:9", "--only", "99"], "no test has the number 99"),
        (["--port", "carrier-pigeon://x"], "carrier-pigeon"),
        (["--port", "udp://127.0.0.1:9", "--key-file", __file__], "only its owner may have access"),
        (["--port", "udp://127.0.0.1:9", "--key-file", "/no/such"], "/no/such"),
    ],
)
def test_wrong_arguments_are_told_in_one_line(
    arguments: list[str], words: str, capsys: Capsys
) -> None:
    assert link_test.main(arguments) == link_test.NOT_EXAMINED
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_numbers_choose_tests_and_none_chooses_all() -> None:
    assert {check.number for check in chosen("2, 5")} == {"2", "5"}
    assert chosen("") == chosen("1,2,3,4,5,6,7,15")
