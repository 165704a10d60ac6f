"""Links that come, go and lie, as the real process lives through them; long ones in simulated time.

The tests share one process, in the order of the file: each begins and ends with all running.
"""

from collections.abc import Iterator
from itertools import pairwise

import pytest

from hw.device import DeviceStatus
from hw.ports.sockets import CONNECT_S
from tests.support.robot.closed_loop import ClosedLoop
from tests.support.robot.house import OK, House

DEVICES = ("scanner", "ahrs", "drive")
# Of a device that is back; the wire itself takes up to half a second of the scanner's one.
WITHIN_S = {"scanner": 1.0 - CONNECT_S, "ahrs": 3.0, "drive": 3.0}


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Iterator[House]:
    one = House(tmp_path_factory.mktemp("life"))
    try:
        yield one
    finally:
        assert one.close() == 0


@pytest.mark.real_time
def test_what_is_absent_at_the_start_is_named_and_runs_once_it_appears(house: House) -> None:
    house.plug_in("drive")
    house.start()
    house.until(lambda: house.health & OK["drive"])
    house.run(1.0)
    assert house.health & 7 == OK["drive"]
    for name, cause in (("scanner", "connection refused by"), ("ahrs", "no such device")):
        told = house.changes(name)
        assert 1 <= len(told) <= 2
        assert any(cause in line["cause"] for line in told)
    house.plug_in("ahrs")
    house.serve_scanner()
    house.until(house.all_run)
    house.run(1.0)
    assert house.all_run()


@pytest.mark.real_time
@pytest.mark.parametrize("gone_s", [0.1, 3.0])
@pytest.mark.parametrize("name", DEVICES)
def test_a_cable_is_pulled_and_put_in_again(house: House, name: str, gone_s: float) -> None:
    house.run(0.5)
    since = len(house.log)
    house.seen.clear()
    house.unplug(name)
    house.run(gone_s)
    house.plug_in(name)
    if name == "scanner" and gone_s < 1.0:  # a network forgets nothing in so short a time
        house.until(house.all_run)
        assert house.changes(name, since) == []
        return
    house.until(lambda: house.changes(name, since))
    house.until(lambda: house.all_run() and house.changes(name, since)[-1]["state"] == "running")
    others = 7 & ~OK[name]
    assert all(health & others == others for health in house.seen)
    assert not any(house.changes(other, since) for other in DEVICES if other != name)
    told = [(line["state"], line["cause"]) for line in house.changes(name, since)]
    assert told[-1] == ("running", "")
    assert 2 <= len(told) <= 6, told
    assert all(one != next_one for one, next_one in pairwise(told))


# --- in simulated time


@pytest.mark.slow
@pytest.mark.parametrize(("name", "gone_s"), [("scanner", 60.0), ("ahrs", 4.0), ("drive", 4.0)])
def test_a_long_time_without_a_device_is_survived_by_the_others(name: str, gone_s: float) -> None:
    loop = ClosedLoop()
    loop.run(2)
    app = loop.app
    of = {section: device.status for section, device in app.devices.by_section.items()}
    assert all(status.state == "running" for status in of.values())
    loop.wires[name].cut = True
    lost = 0

    def watch() -> None:
        nonlocal lost
        lost += any(status.state != "running" for other, status in of.items() if other != name)

    loop.run(gone_s, watch)
    assert of[name].state == "closed"
    assert lost == 0
    loop.wires[name].cut = False
    until_heard(loop, of[name], within_s=WITHIN_S[name])


def until_heard(loop: ClosedLoop, device: DeviceStatus, within_s: float) -> None:
    back_s = loop.now_s
    while device.state != "running" or device.heard_s <= back_s:
        assert loop.now_s < back_s + within_s, device.cause
        loop.step()


def test_a_scanner_that_boots_is_heard_within_a_second_of_its_mirror_being_up() -> None:
    loop = ClosedLoop()
    loop.run(1.5)
    scanner = loop.rig.scanner
    scanner.start_silent_s = 1.37
    loop.wires["scanner"].cut = True
    loop.run(0.1)
    loop.wires["scanner"].cut = False
    scanner.reboot(loop.now_s)
    loop.run(scanner.start_silent_s + scanner.spin_up_s)
    until_heard(loop, loop.app.devices.scanner.status, within_s=1.0)
