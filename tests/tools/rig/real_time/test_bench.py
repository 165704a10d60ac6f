"""The far end as a meter: stamps, matching frames with scans, load, and one short measurement."""

import os
from collections import deque
from pathlib import Path

import pytest
from rich.console import Console

from fakes.programs.stamps import StampedScanner
from mapod_link.frames import GEOM, MAP, POSE, bytes_from_frame
from tests import Patch
from tools.rig import latency
from tools.rig.real_time import bench
from tools.rig.real_time.bench import Burst, FarEnd, Sent, scans_from_file, told_scans
from tools.rig.real_time.load import loaded
from tools.terminal.processes import Stop

SCAN = b"\x02\x02\x02\x02....sSN LMDscandata and so on"
GEOM_BODY = bytes([1, 0, 9, 0, 5, 0, 200, 0, 1, 0, 0, 0, 20, 0, 150, 0])


def scans(count: int, begin_s: float = 100.0) -> list[Sent]:
    """Scans every 20 ms, each sent 1 ms after its last beam."""
    return [Sent(begin_s + 0.02 * k, begin_s + 0.02 * k + 0.001) for k in range(count)]


def burst(tick_s: float, mapped_s: float, arrived_s: float) -> Burst:
    """What a sender's tick that has mapped up to an instant looks like from afar."""
    age = int((tick_s - mapped_s) / 0.004)
    return Burst(round(tick_s * 1000) % 2**32, arrived_s, min(age, 255))


def test_each_scan_is_matched_with_the_first_tick_that_tells_of_it() -> None:
    sent = scans(5)
    bursts = [
        burst(sent[1].sent_s + 0.001, sent[1].measured_s, sent[1].sent_s + 0.002),
        burst(sent[1].sent_s + 0.015, sent[1].measured_s, sent[1].sent_s + 0.016),
        burst(sent[3].sent_s + 0.003, sent[3].measured_s, sent[3].sent_s + 0.004),
    ]
    told, strangers = told_scans(sent, bursts)
    assert strangers == 0
    assert [one.scan for one in told] == [sent[1], sent[3]]
    assert [one.latency_s for one in told] == pytest.approx([0.002, 0.004])
    used = [burst(s.sent_s + 0.002, s.measured_s - 0.0125, s.sent_s + 0.003) for s in sent]
    assert told_scans(sent, used)[1] == 5
    assert [one.scan for one in told_scans(sent, used, unused_s=0.0125)[0]] == sent
    strange, without_a_scan = burst(101.0, 100.9, 101.0), Burst(100_000, 100.0, 255)
    assert told_scans(sent[:2], [strange, without_a_scan]) == ([], 1)


@pytest.mark.parametrize("off_s", [-0.004, 0.0, 0.004])
def test_the_senders_clock_of_a_sensor_may_be_off_by_milliseconds(off_s: float) -> None:
    sent = scans(50, begin_s=4_294_967.0)  # its milliseconds wrap within the span
    bursts = [burst(s.sent_s + 0.002, s.measured_s + off_s, s.sent_s + 0.003) for s in sent]
    told, strangers = told_scans(sent, bursts)
    assert strangers == 0
    assert [one.scan for one in told] == sent
    assert max(one.latency_s for one in told) == pytest.approx(0.003)


def test_frames_of_one_tick_are_one_burst_that_has_arrived_with_its_last_frame() -> None:
    end = FarEnd()
    end.feed_datagram(1.0, bytes_from_frame(GEOM, 1, 1000, GEOM_BODY))
    end.feed_datagram(1.5, bytes_from_frame(POSE, 2, 1500, bytes(20) + bytes([7, 1, 1, 1])))
    end.feed_datagram(1.501, bytes_from_frame(MAP, 3, 1500, bytes(10)))
    end.feed_datagram(1.52, bytes_from_frame(POSE, 4, 1520, bytes(20) + bytes([2, 1, 1, 1])))
    assert end.bursts[1:] == [Burst(1500, 1.501, 7), Burst(1520, 1.52, 2)]


class Teller:
    """A device that says what it is told to say."""

    def __init__(self, *says: bytes) -> None:
        self._says = list(says)

    def exchange(self, now_s: float, received: bytes) -> bytes:
        return self._says.pop(0)


def test_a_scan_is_stamped_as_it_leaves_and_answers_are_not(tmp_path: Path) -> None:
    lines: list[str] = []
    teller = Teller(b"", b"sRA answer", SCAN)
    fake = StampedScanner(teller, deque([4.9, 4.98]), lines, lambda: 5.125)
    for now_s in (4.9, 5.0, 5.0):
        fake.exchange(now_s, b"")
    path = tmp_path / "stamps.txt"
    path.write_text("".join(lines) + "scan 1.0")  # the last line is not whole
    assert scans_from_file(path) == [Sent(4.98, 5.125)]


def test_load_begins_and_leaves_no_process() -> None:
    before = set(children())
    with loaded(30.0, cores=1) as words:
        begun = set(children()) - before
    assert words == "1 computing, 1 moving memory, 1 writing to the disk"
    assert len(begun) >= 3
    assert len(begun - set(children())) >= 3  # Python's own helper stays


def children() -> list[int]:
    path = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
    return [int(word) for word in path.read_text().split()]


@pytest.mark.real_time
def test_a_measurement_finds_each_scan_at_the_far_end(monkeypatch: Patch) -> None:
    monkeypatch.setattr(bench, "SETTLE_S", 1.0)
    with Stop().on_signals() as stop:
        row = latency.measure("alone", 2.0, stop, load=False)
    assert row.scans > 60
    assert row.told > 0.9 * row.scans
    assert row.strangers <= 0.02 * row.scans
    assert row.ticks > row.scans
    console = Console(width=120)
    with console.capture() as shown:
        console.print(latency.table_of([row]))
    assert f"{row.told} of {row.scans}" in shown.get()
    assert row.rights.startswith("SCHED_FIFO ")
