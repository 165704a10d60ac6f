"""Every fault that the fakes and their wires can be given while the robot drives.

`draw` gives some of them by chance for one run, in a timetable's words. What a fake
can be told and is no fault stands in NO_FAULTS, with the reason: nothing is left out in silence.
"""

import random

from tools.rig import fault_list_ahrs, fault_list_drive, fault_list_scanner
from tools.rig.fault_kinds import Fault, Must, stops

CATALOGUE: tuple[Fault, ...] = (
    *fault_list_scanner.SCANNER,
    *fault_list_ahrs.AHRS,
    *fault_list_drive.DRIVE,
    *fault_list_drive.PLANNER,
)
LIVE = (  # of sockets and ptys: not in process, but in the live rig (`make rig ARGS="--fault ..."`)
    stops("scanner.unplugged", "its cable is pulled: nothing comes, and later all at once"),
    stops("ahrs.gone", "its USB adapter is pulled: its path is gone", again=False),
    stops("drive.gone", "its USB adapter is pulled: its path is gone; its watchdog stops"),
)
NO_FAULTS: dict[str, str] = {
    **fault_list_scanner.NO_FAULTS,
    **fault_list_ahrs.NO_FAULTS,
    **fault_list_drive.NO_FAULTS,
}
DRAWN_DEVICES = ("scanner", "ahrs", "drive")  # the planner's end differs from run to run
SHARES: dict[Must, float] = {"stops": 0.5, "either": 0.35, "goes on": 0.15}  # of what is drawn
DRAW_FROM_S, DRAW_TO_S = 4.0, 40.0  # of a run


def drawn_faults(must: Must) -> tuple[Fault, ...]:
    """What a campaign draws from: of the devices and their wires, of which this must come."""
    return tuple(
        fault
        for fault in CATALOGUE
        if fault.drawn and fault.device in DRAWN_DEVICES and fault.must == must
    )


def draw(seed: int, n: int, from_s: float = DRAW_FROM_S, to_s: float = DRAW_TO_S) -> list[str]:
    """The orders of n faults by chance, in a timetable's words, within a run's seconds.

    The same seed gives the same orders; no device gets two faults at once.
    """
    chance = random.Random(f"faults {seed}")
    orders: list[str] = []
    busy: list[tuple[str, float, float]] = []
    while n > 0:
        [must] = chance.choices(list(SHARES), list(SHARES.values()))
        fault = chance.choice(drawn_faults(must))
        start_s = round(chance.uniform(from_s, to_s), 1)
        end_s = start_s + fault.lasts_s + 1.0
        if any(d == fault.device and start_s < e and s < end_s for d, s, e in busy):
            continue
        busy.append((fault.device, start_s, end_s))
        orders += fault.orders(start_s)
        n -= 1
    return orders


def words_of(name: str) -> list[str]:
    """The names of the handles that a fault's name may mean: with a dictionary's key, and without.

    >>> words_of("scanner.alter_at.400")
    ['scanner.alter_at.400', 'scanner.alter_at']
    """
    whole = name.partition("=")[0]
    return [whole, whole.rpartition(".")[0]]


def handles_in_catalogue() -> set[str]:
    """The names, with their devices, of all that some fault of the catalogue sets or calls."""
    return {
        word
        for fault in (*CATALOGUE, *LIVE)
        for order in (fault.own, *fault.also, *fault.then, *fault.after)
        for word in words_of(order)
    }
