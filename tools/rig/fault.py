"""One fault of the rig's catalogue: how it is ordered of the fakes, and what must come of it.

A fault is one or more orders in the words of `fakes.faults.timetable`; what must come of it is what
design and docs/ say: the robot stops, or goes on, or may do either, and all is well again in time
after its end.
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal

Must = Literal["stops", "goes on", "either"]

STANDS_S = 2.0  # an input's time-out, a loop, and the way to a stop from 0.8 m/s
RECOVERS_S = 6.0
THEN_S, AFTER_S = 0.1, 0.2
BLIND = "cannot be noticed"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault and what must come of it. Orders are name[=value], as a timetable has them."""

    name: str  # device, and attribute or event; "scanner.wire.mute"
    why: str  # of what must come; begins with BLIND where nothing can be known of the fault
    value: str = ""  # as text; "" switches it on, or is an event without a number
    lasts_s: float = 3.0  # until it ends; 0: it happens at once, or ends by itself
    must: Must = "either"  # what the robot does meanwhile
    stands_s: float = STANDS_S  # where it must stop: after so long at most it stands
    recovers_s: float = RECOVERS_S  # after its end: all inputs well again, the map valid
    again: bool = True  # it then drives by itself; False: waits for a person, or seen ground
    also: tuple[str, ...] = ()  # orders that begin together with it and end with it
    then: tuple[str, ...] = ()  # events that happen 0.1 s after its begin
    after: tuple[str, ...] = ()  # events 0.2 s after its end, as a person would see to them
    drawn: bool = True  # a campaign may draw it at random

    @property
    def device(self) -> str:
        return self.name.partition(".")[0]

    @property
    def own(self) -> str:
        """Its first order, without the time."""
        return f"{self.name}={self.value}" if self.value else self.name

    @property
    def title(self) -> str:
        return " + ".join([self.own, *self.also, *self.then])

    @property
    def is_noticed(self) -> bool:
        return not self.why.startswith(BLIND)

    def orders(self, start_s: float) -> list[str]:
        """What to order of the fakes, beginning at start_s of the run.

        >>> stops("drive.mute", "", lasts_s=2.0, after=("drive.reset",)).orders(5.0)
        ['drive.mute@5s+2s', 'drive.reset@7.2s']
        """
        span = f"@{start_s:g}s" + (f"+{self.lasts_s:g}s" if self.lasts_s else "")
        orders = [f"{order}{span}" for order in (self.own, *self.also)]
        orders += [f"{event}@{start_s + THEN_S:g}s" for event in self.then]
        return orders + [f"{event}@{start_s + self.lasts_s + AFTER_S:g}s" for event in self.after]


stops = partial(Fault, must="stops")
goes_on = partial(Fault, must="goes on")
either = partial(Fault, must="either")

LATER = "a delay that changes makes the clock doubtful until it is known again"
LATER_S = 15.0


def wire_faults(
    device: str,
    hidden: tuple[str, ...],  # attributes that the device has by the same name: behind "wire."
    stale: str,  # what the loss of this input means, in words
    rate: str,  # share of bytes of which few frames are hit
    byte: int,  # an offset in the device's stream that goes by while the fault lasts
) -> tuple[Fault, ...]:
    """The faults that every stream's wire has."""
    few = "the next frame is there in time, or the input is stale"
    host = "only what mapod asks gets lost: it asks again, or finds the input stale"
    mute, drop_rate = (
        f"{device}.wire.{name}" if name in hidden else f"{device}.{name}"
        for name in ("mute", "drop_rate")
    )
    return (
        stops(mute, stale),
        stops(f"{device}.cut", stale),
        either(f"{device}.delay_s", LATER, "0.03", recovers_s=LATER_S),
        either(f"{device}.delay_s", LATER, "0.5", recovers_s=LATER_S),
        either(drop_rate, few, rate),
        either(f"{device}.damage_rate", few, rate),
        either(f"{device}.host_drop_rate", host, "0.05"),
        either(f"{device}.host_damage_rate", host, "0.05"),
        goes_on(f"{device}.alter_at.{byte}", few, "255", drawn=False),
        goes_on(f"{device}.drop_at", few, f"{byte},{byte + 1}", drawn=False),
        goes_on(f"{device}.chunk", "a stream may be cut anywhere", "7"),
    )
