"""Faults by name and on a timetable, and what stands behind a fake that runs alone."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.faults.timetable import FaultError, Order, Schedule, list_of_all, order_from_text
from fakes.wires.wire import MemoryPort, Wire
from fakes.world.simple import COUNTS_PER_S, Motion, Room, TwoWheels
from tests.support.cases import examples


class Device:
    """A fake with one attribute of each kind."""

    def __init__(self) -> None:
        self.mute = False  # says nothing
        self.late_s, self.count, self.words = 0.0, 3, "well"
        self.sort: Literal["wrap", "zero"] = "wrap"  # what it does
        self.pair, self.bias = (0, 0), np.zeros(3)
        self.refuse: dict[str, int] = {}  # name -> code
        self.flash = {0x00: 1, 0x0F: 16}
        self.gaps: set[int] = set()
        self.never: set[str] = set()
        self.maybe: int | None = None
        self.happened: list[object] = []
        self._hidden = 0

    def reboot(self, now_s: float) -> None:
        """Power off and on."""
        self.happened.append(now_s)

    def brown_out(self, now_s: float, *, forgets: bool = False) -> None:
        self.happened.append((now_s, forgets))

    def command(self, one: int, two: int) -> None:
        self.happened.append((one, two))

    def exchange(self, now_s: float, received: bytes) -> bytes:
        return b""


def scheduled(device: Device, *texts: str) -> Schedule:
    return Schedule([order_from_text(text) for text in texts], {"": [device]})


@pytest.mark.parametrize(
    ("text", "order"),
    [
        ("mute@5s", Order("mute", None, 5.0, None)),
        ("mute=off@250ms-1m", Order("mute", "off", 0.25, 60.0)),
        ("refuse.LMPoutputRange=10@1.5", Order("refuse.LMPoutputRange", "10", 1.5, None)),
        ("refuse.sRN EIHstCola=3@0+.5s", Order("refuse.sRN EIHstCola", "3", 0.0, 0.5)),
        ("words=@1s", Order("words", "", 1.0, None)),
        ("scanner.late_s=-1@2+3", Order("scanner.late_s", "-1", 2.0, 5.0)),
    ],
)
def test_a_fault_is_written_with_its_value_and_its_time(text: str, order: Order) -> None:
    assert order_from_text(text) == order


@pytest.mark.slow
@settings(max_examples=examples(20))
@given(text=st.text(max_size=20) | st.from_regex(r"[a-z_.]{1,9}(=[a-z0-9,]*)?@[0-9ms+-]{1,6}"))
def test_no_text_does_anything_but_make_a_schedule_or_be_refused(text: str) -> None:
    device = Device()
    try:
        schedule = scheduled(device, text)
    except FaultError:
        return
    schedule.step(0.0)
    schedule.step(1e9)


@pytest.mark.parametrize(
    ("fault", "becomes"),
    [
        ("mute", True),
        ("mute=on", True),
        ("late_s=0.25", 0.25),
        ("late_s=250ms", 0.25),
        ("count=0x10", 16),
        ("words=as well", "as well"),
        ("sort=zero", "zero"),
        ("pair=3,-4", (3, -4)),
        ("refuse.LMCstartmeas=3", {"LMCstartmeas": 3}),
        ("flash.0x0F=0x20", {0: 1, 15: 32}),
        ("gaps=1,2", {1, 2}),
        ("never=?R,^01", {"?R", "^01"}),
        ("maybe=7", 7),
    ],
)
def test_an_attribute_of_each_kind_is_set_in_time_and_restored(fault: str, becomes: object) -> None:
    device, name = Device(), fault.split("=")[0]
    attribute = name.split(".")[0]
    before = getattr(device, attribute)
    schedule = scheduled(device, f"{fault}@1s-2s")
    assert (schedule.step(50.0), schedule.step(50.99)) == ([], [])
    assert getattr(device, attribute) == before
    assert len(schedule.step(51.0)) == 1
    assert getattr(device, attribute) == becomes
    assert schedule.step(52.0) == [f"{name} off"]
    assert getattr(device, attribute) == before


def test_an_entry_that_ends_leaves_the_others() -> None:
    device = Device()
    schedule = scheduled(device, "refuse.A=3@1s-3s", "refuse.B=4@2s-4s")
    seen = []
    for now_s in (0.0, 1.0, 2.0, 3.0, 4.0):
        schedule.step(now_s)
        seen.append(device.refuse)
    assert seen == [{}, {"A": 3}, {"A": 3, "B": 4}, {"B": 4}, {}]


def test_events_happen_once_with_what_they_take() -> None:
    device = Device()
    schedule = scheduled(
        device, "reboot@1s", "brown_out@1s", "brown_out=forgets@2s", "command=5,-6@2s"
    )
    assert schedule.step(10.0) == []
    assert schedule.step(13.0) == ["reboot now", "brown_out now", "brown_out now", "command now"]
    assert schedule.step(14.0) == []
    assert device.happened == [13.0, (13.0, False), (13.0, True), (5, -6)]


@pytest.mark.parametrize(
    ("text", "told"),
    [
        *((text, "") for text in ("", "mute", "@5s", "mute@", "mute@5s-", "mute@-5s", "a@1@2")),
        ("mute@5x", "'5x' is no time"),
        ("mute@5s-4s", "ends before it begins"),
        ("moote@1s", "there are bias, brown_out, command, count"),
        ("exchange@1s", "no such fault"),
        ("_hidden=1@1s", "no such fault"),
        ("mute=maybe@1s", "mute: takes on|off, given 'maybe'"),
        ("late_s@1s", "late_s: takes number, given nothing"),
        ("late_s=x@1s", "late_s: takes number, given 'x'"),
        ("count=1.5@1s", "count: takes integer, given '1.5'"),
        ("sort=other@1s", "sort: takes wrap|zero, given 'other'"),
        ("pair=1@1s", "pair: takes 2 numbers, given '1'"),
        ("refuse=3@1s", "refuse: takes refuse.KEY=VALUE, given '3'"),
        ("refuse.A=x@1s", "refuse: takes refuse.KEY=VALUE, given 'x'"),
        ("mute.A=1@1s", "mute: takes on|off, given '1'"),
        ("command=1@1s", "command: takes one,two, given 1"),
        ("reboot=now@1s", "reboot: takes nothing, given now"),
        ("reboot@1s-2s", "reboot: happens at once and has no end"),
    ],
)
def test_what_cannot_be_set_is_said_before_anything_starts(text: str, told: str) -> None:
    with pytest.raises(FaultError) as caught:
        scheduled(Device(), text)
    assert str(caught.value)
    assert told in str(caught.value)


def test_of_several_devices_each_is_called_by_its_name() -> None:
    one, two = Device(), Device()
    targets = {"one": [one], "two": [two]}
    Schedule([order_from_text("two.mute@0s")], targets).step(5.0)
    assert (one.mute, two.mute) == (False, True)
    with pytest.raises(FaultError, match="write one of one, two"):
        Schedule([order_from_text("mute@0s")], targets)
    assert list_of_all(targets).count("\n  mute ") == 2


def test_a_name_of_both_is_the_fakes_and_the_wires_has_wire_in_front() -> None:
    device = Device()
    wire = Wire(device, MemoryPort(), 1)
    texts = ("wire.mute@0s", "delay_s=2@0s", "alter_at.3=255@0", "bias=0.1,0,-0.2@0")
    Schedule([order_from_text(text) for text in texts], {"": [device, wire]}).step(0.0)
    assert (device.mute, wire.mute, wire.delay_s, wire.alter_at) == (False, True, 2.0, {3: 255})
    assert device.bias.tolist() == [0.1, 0.0, -0.2]


def test_the_list_tells_kind_value_and_the_comment_of_the_class() -> None:
    text = list_of_all({"": [Device()]})
    [line] = [line for line in text.splitlines() if line.startswith("  sort ")]
    assert line.split() == ["sort", "wrap|zero", "now", "'wrap'", "what", "it", "does"]
    assert "Power off and on." in text


def ranges(scene: str, *bearings_deg: float) -> list[float]:
    bearings_rad = np.radians(bearings_deg)
    return list(Room(scene).ranges_m_at(0.0, np.zeros(len(bearings_rad)), bearings_rad))


def test_the_room_has_four_walls_and_one_wall_is_ahead_and_nothing_behind() -> None:
    np.testing.assert_allclose(ranges("room", 0, 90, 180, -90), [5.0, 2.5, 3.0, 2.0])
    np.testing.assert_allclose(ranges("room", 45, -45), [2.5 * 2**0.5, 2.0 * 2**0.5])
    np.testing.assert_allclose(ranges("wall:2", 0, 60, 120, 180), [2.0, 4.0, np.nan, np.nan])
    assert np.isnan(ranges("empty", 0, 60, 120, 180)).all()


@pytest.mark.parametrize("scene", ["", "rooom", "wall", "wall:near", "room:3"])
def test_a_scene_that_there_is_not_is_refused(scene: str) -> None:
    with pytest.raises(ValueError):
        Room(scene)
    with pytest.raises(ValueError):
        Motion(scene)


@given(scene=st.sampled_from(["still", "turning", "swaying"]), t_s=st.floats(0, 100))
def test_a_motion_is_one_whose_rates_are_those_of_its_attitude(scene: str, t_s: float) -> None:
    motion = Motion(scene)
    (R, rate, force), (R_after, _, _) = motion.motion_at(t_s), motion.motion_at(t_s + 1e-5)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-12)
    turned = (R.T @ R_after - np.eye(3)) / 1e-5
    np.testing.assert_allclose([turned[2, 1], turned[0, 2], turned[1, 0]], rate, atol=1e-3)
    np.testing.assert_allclose(R @ force, [0.0, 0.0, 9.81], atol=1e-9)


def test_the_wheels_reach_their_speed_and_stop() -> None:
    wheels = TwoWheels()
    wheels.set_power(1.0, -0.5)
    for k in range(401):
        wheels.step_to(10.0 + k * 0.005)
    before = wheels.counts()
    wheels.step_to(12.1)
    turned = [b - a for a, b in zip(before, wheels.counts(), strict=True)]
    np.testing.assert_allclose(turned, [0.1 * COUNTS_PER_S, -0.05 * COUNTS_PER_S], rtol=0.01)
    wheels.set_power(0.0, 0.0)
    wheels.step_to(13.1)
    held = wheels.counts()
    wheels.step_to(14.1)
    np.testing.assert_allclose(wheels.counts(), held, atol=5.0)
