"""The catalogue of faults: nothing left out, all of it can be ordered, and a sample is driven."""

from contextlib import ExitStack, closing

import pytest

from fakes.faults.handles import handles
from fakes.wires.wire import PtyWire, TcpWire
from tools.rig.faults.catalogue import CATALOGUE, DRAWN_DEVICES, NO_FAULTS, Fault, draw
from tools.rig.faults.drive import Drive, drive_with, hall, harm, problems
from tools.rig.faults.stripe import NO_FAULTS_STRIPE, STRIPE
from tools.rig.faults.stripe import ROBOT as SMALL_ROBOT
from tools.rig.faults.urg04lx import NO_FAULTS_URG04LX, ROBOT, URG04LX
from tools.rig.runs.loop import Loop

PTYS = ("ahrs", "drive")
BY_TITLE = {fault.title: fault for fault in CATALOGUE}


@pytest.fixture(scope="module")
def loop() -> Loop:
    return Loop(hall())


def all_handles(loop: Loop) -> set[str]:
    """Whatever can be set or called of any fake and its wires, with the device's name.

    Each wire of a device counts: the one in memory, and those that other programs reach.
    """
    fakes = loop.fakes
    with closing(TcpWire(fakes["scanner"])) as tcp, ExitStack() as stack:
        real = {name: stack.enter_context(closing(PtyWire(fakes[name]))) for name in PTYS}
        return {
            f"{device}.{name}"
            for wires in (loop.wires, {"scanner": tcp}, real)
            for device, wire in wires.items()
            for name in handles(fakes[device], wire)
        }


def test_all_that_can_be_ordered_of_the_fakes_is_in_the_catalogue_or_excused(loop: Loop) -> None:
    orders = (o for f in CATALOGUE for o in (f.own, *f.also, *f.then, *f.after))
    names = {order.partition("=")[0] for order in orders}
    known = names | {name.rpartition(".")[0] for name in names}  # with a dictionary's key behind
    assert sorted(all_handles(loop) - known - NO_FAULTS.keys()) == []
    assert sorted(NO_FAULTS.keys() - all_handles(loop)) == []  # no excuse for what there is not


def test_every_fault_of_the_catalogue_can_be_ordered_and_has_a_name_of_its_own(loop: Loop) -> None:
    loop.set_faults([order for fault in CATALOGUE for order in fault.orders(5.0)])
    assert len(BY_TITLE) == len(CATALOGUE)
    for device in DRAWN_DEVICES:
        musts = {fault.must for fault in CATALOGUE if fault.device == device}
        assert musts == {"stops", "goes on", "either"}


@pytest.mark.parametrize(
    ("robot", "catalogue", "excused"),
    [(ROBOT, URG04LX, NO_FAULTS_URG04LX), (SMALL_ROBOT, STRIPE, NO_FAULTS_STRIPE)],
)
def test_all_that_can_be_ordered_of_another_robots_scanner_is_in_its_catalogue_or_excused(
    robot: str, catalogue: tuple[Fault, ...], excused: dict[str, str]
) -> None:
    drive = Drive([], (1.0, 2.0), 1.0, robot=robot)
    fake, wire = drive.loop.fakes["scanner"], drive.loop.wires["scanner"]
    there = {f"scanner.{name}" for name in handles(fake, wire)}
    orders = (o for f in catalogue for o in (f.own, *f.also, *f.then, *f.after))
    names = {order.partition("=")[0] for order in orders}
    known = names | {name.rpartition(".")[0] for name in names}  # with a dictionary's key behind
    assert sorted(there - known) == sorted(excused)
    drive.loop.set_faults([order for fault in catalogue for order in fault.orders(5.0)])
    assert len({fault.title for fault in catalogue} | BY_TITLE.keys()) == len(catalogue) + len(
        BY_TITLE
    )


def test_faults_are_drawn_alike_for_one_seed_and_can_be_ordered(loop: Loop) -> None:
    assert draw(3, 2) == draw(3, 2)
    assert draw(3, 2) != draw(4, 2)
    loop.set_faults([order for seed in range(200) for order in draw(seed, 2, 4.0, 30.0)])
    assert all(len(draw(seed, 3)) >= 3 for seed in range(50))
    drawn = {draw(seed, 1)[0].partition("@")[0] for seed in range(300)}
    assert len(drawn) > 80
    assert {name.partition(".")[0] for name in drawn} == set(DRAWN_DEVICES)


@pytest.mark.slow
def test_a_fault_while_driving_does_what_the_catalogue_says() -> None:
    fault = BY_TITLE["scanner.wire.mute"]
    outcome = drive_with(fault)
    assert problems(fault, outcome) == []
    assert outcome.told


@pytest.mark.slow
@pytest.mark.parametrize(
    "title", [one.title for one in CATALOGUE if one.device == "drive" and one.must != "goes on"]
)
def test_each_fault_of_the_motor_controller_that_may_stop_it_does_what_the_catalogue_says(
    title: str,
) -> None:
    """What the wheels tell decides what of a map outlives a fault; `make faults` has all others."""
    assert problems(BY_TITLE[title], drive_with(BY_TITLE[title])) == []


@pytest.mark.slow
def test_a_hokuyo_whose_laser_goes_off_stops_the_robot_for_a_second_or_so() -> None:
    [fault] = [one for one in URG04LX if one.own == "scanner.switch_laser_off"]
    outcome = drive_with(fault)
    assert problems(fault, outcome) == []
    assert outcome.told[0] == "scanner"


@pytest.mark.slow
def test_the_small_robot_stops_before_the_box_and_where_its_laser_goes_off() -> None:
    alone = Drive([], (5.0, 5.0), 3.0, robot=SMALL_ROBOT).run()
    assert harm(alone) == []
    assert alone.stood_s is None  # before the box alone
    [fault] = [one for one in STRIPE if one.own == "scanner.laser=0"]
    outcome = drive_with(fault)
    assert problems(fault, outcome) == []
    assert outcome.told[0] == "scanner"


@pytest.mark.slow
def test_a_box_on_ground_that_somebody_vouched_for_is_hit_and_that_is_seen() -> None:
    """Nearer than 6.7 m the laser looks over it: the operator's word for the start is wrong."""
    outcome = Drive([], (2.0, 2.5), 5.0, scene=hall(box_x_m=2.0)).run()
    [words] = outcome.collisions
    assert words.startswith("box at ")
    assert any("collision" in problem for problem in harm(outcome))
