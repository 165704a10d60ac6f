"""The app under faults on its wires: it runs on, counts, recovers, and takes free back."""

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from core.records import FREE
from tests.support.cases import examples, few
from tests.support.robot.closed_loop import ClosedLoop

DEVICES = ("scanner", "ahrs", "drive")
HEALTH_BIT = {"scanner": 1 << 0, "ahrs": 1 << 1, "drive": 1 << 2}
STALE_S = 0.45 + 0.15  # the longest of the inputs' limits, and one of the link


def is_well(loop: ClosedLoop) -> bool:
    """All inputs fresh, as the planner was told."""
    pose = loop.planner.pose
    is_fresh = pose is not None and pose.mode == 1 and pose.health & 0x37 == 0x37
    return is_fresh and not loop.planner.stale(loop.now_s)


def run_until_well(loop: ClosedLoop, within_s: float) -> None:
    for _ in range(round(within_s * 200)):
        if is_well(loop):
            return
        loop.step()
    raise AssertionError(f"not well after {within_s} s: {loop.planner.pose}")


def free_told(loop: ClosedLoop) -> int:
    return int((loop.planner.window() == 1).sum())


@pytest.mark.parametrize("fault", few(["cut", "mute"], 1))
def test_silence_is_named_takes_free_back_and_is_recovered_from(fault: str) -> None:
    loop = ClosedLoop()
    loop.run(6.0)
    for device in DEVICES:
        assert free_told(loop) > 60
        fall_silent_and_recover(loop, device, fault)
    assert not loop.planner.suspect


def fall_silent_and_recover(loop: ClosedLoop, device: str, fault: str) -> None:
    setattr(loop.wires[device], fault, True)
    loop.run(STALE_S)
    pose = loop.planner.pose
    assert pose is not None
    assert not pose.health & HEALTH_BIT[device]
    assert pose.mode == 3
    others = [bit for name, bit in HEALTH_BIT.items() if name != device and name != "scanner"]
    assert all(pose.health & bit for bit in others)
    loop.run(0.5)
    assert free_told(loop) == 0
    assert int((loop.planner.window() == 2).sum()) > 20  # obstacles stay
    told_free = []
    loop.run(0.5, lambda: told_free.append(free_told(loop)))
    assert not any(told_free)
    setattr(loop.wires[device], fault, False)
    run_until_well(loop, 6.0)
    loop.run(1.0)


@given(
    device=st.sampled_from(DEVICES),
    offset=st.integers(0, 3000),
    mask=st.integers(1, 255),
    what=st.sampled_from(["alter", "drop", "delay"]),
)
@settings(max_examples=examples(2), phases=[Phase.generate])
def test_any_byte_altered_or_lost_is_survived(
    device: str, offset: int, mask: int, what: str
) -> None:
    loop = ClosedLoop()
    wire = loop.wires[device]
    if what == "alter":
        wire.alter_at = {offset: mask}
    elif what == "drop":
        wire.drop_at = {offset}
    else:
        wire.delay_s = 0.001 * (offset % 60)
    loop.run(2.5)
    wire.delay_s = 0.0
    run_until_well(loop, 8.0)
    cells = loop.map_now()
    assert int((cells == FREE).sum()) > 10


@pytest.mark.parametrize("device", few(DEVICES, 1))
def test_a_noisy_wire_is_counted_and_survived(device: str) -> None:
    loop = ClosedLoop()
    loop.run(2.0)
    loop.wires[device].damage_rate = 0.02 if device == "drive" else 0.001  # it says little
    loop.run(2.0)
    loop.wires[device].damage_rate = 0.0
    run_until_well(loop, 8.0)
    assert getattr(loop.app.devices, device).status.rejected > 0


def test_a_planner_that_comes_late_or_loses_frames_still_gets_the_whole_map() -> None:
    loop = ClosedLoop()
    loop.planner.deaf = loop.planner.mute = True
    loop.run(2.5)
    loop.planner.deaf = loop.planner.mute = False
    loop.planner.loss_rate = 0.05
    loop.run(1.0)
    loop.planner.loss_rate = 0.0
    loop.run(0.7)
    meant = np.array([0, 2, 1], dtype=np.uint8)[loop.map_now()]
    assert int((loop.planner.window() != meant).sum()) <= 20
    assert not loop.planner.suspect
