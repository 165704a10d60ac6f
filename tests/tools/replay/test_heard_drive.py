"""What an AX3500 answers to somebody else: counters at their instants, and its state."""

import pytest

from config_file import load_config
from core.records import WheelCounts
from hw.ax3500.lines import CHARACTER_S
from hw.ax3500.session import LOST_S, Ax3500, Ax3500Options
from tests import ROOT
from tools.replay.heard_drive import heard_ax3500
from tools.replay.ports import Became, PlayedPort


class Overheard:
    """A controller that is asked by another app."""

    def __init__(self) -> None:
        config = load_config((ROOT / "mapod.toml").read_text(encoding="utf-8"))
        options = config.drive.options
        assert isinstance(options, Ax3500Options)
        self.port = PlayedPort(datagrams=False)
        self.port.becomes(Became(use=1, is_open=True, opened=1, backlog=0, cause=""))
        self.drive: Ax3500 = heard_ax3500(self.port, options, config)
        self.now_s, self.counts = 10.0, list[WheelCounts]()
        self.step(b"")

    def step(self, data: bytes, after_s: float = 0.02) -> None:
        self.now_s += after_s
        if data:
            self.port.arrives(data)
        self.counts += self.drive.step(self.now_s)
        self.port.end_call()

    def ask(self, query: bytes, answer: bytes) -> None:
        self.port.asked.append((self.now_s, query + b"\r"))
        self.step(query + b"\r" + answer)


def test_counters_are_of_the_instants_at_which_they_were_asked_for() -> None:
    heard = Overheard()
    for k in range(4):
        heard.ask(b"?Q0", b"%02X\r" % (10 * k))
        heard.ask(b"!A20", b"+\r")
        heard.ask(b"?Q1", b"%02X\r" % (20 * k))
    assert heard.drive.status.state == "running"
    first, *_, newest = heard.counts
    assert (newest.left - first.left) / (newest.right - first.right) in (0.5, 2.0)
    asked_s = heard.now_s - 0.08  # the newest ?Q1 but one, which lies between two of ?Q0
    read_s = asked_s + 0.02 - 2 * CHARACTER_S
    assert newest.t_s == pytest.approx((asked_s + 4 * CHARACTER_S + read_s) / 2)
    assert heard.port.written == []  # nobody is asked


def test_what_answers_no_known_query_counts_for_nothing() -> None:
    heard = Overheard()
    for answer in (b"?Q0\r05\r", b"?Q1\r05\r", b"05\r", b"?Q0\rZZ\r"):
        heard.step(answer)  # by whom and when these were asked is not known
    assert heard.counts == []
    assert heard.drive.status.state == "starting"
    assert heard.drive.status.rejected == 1


def test_its_state_its_restart_and_its_silence_are_told() -> None:
    heard = Overheard()
    heard.ask(b"^8A", b"68\r")
    heard.ask(b"?I", b"01\r01\r00\r")
    assert heard.drive.identity == "^8A 68"
    assert heard.drive.emergency_stop
    assert heard.drive.trouble == "the emergency stop is pressed"
    for _ in range(2):
        heard.ask(b"?Q0", b"05\r")
        heard.ask(b"?Q1", b"05\r")
    assert heard.drive.status.state == "running"
    heard.step(b"", LOST_S + 0.1)
    assert heard.drive.status.cause.startswith("no counters for 2 s")
    for _ in range(2):
        heard.ask(b"?Q0", b"05\r")
        heard.ask(b"?Q1", b"05\r")
    heard.step(b"OK\r")
    assert heard.drive.status.cause == "the controller has restarted: it sent 'OK'"
    assert heard.drive.status.losses == 2
