"""The way that wheels alone tell while the attitude stays away, and whether it may be believed.

Where the body pointed meanwhile, nobody saw. The wheels tell how it turned, and the attitude, once
it is back, how it has turned in all: two sources that know nothing of each other. Where both agree,
and the way was so short that what they can't see hides little, place and heading are still known.
What they can't see: wheels that slip turn the body less than they tell, all along a turn, so the
end shows the most of it; what was turned back again shows nowhere. And a body points a little askew
of its way.
"""

import math

GAP_S = 0.5  # an interval longer than this is checked for what it can hide
HIDDEN_M = 0.1  # position error that such an interval, or a way without attitude, may hide
BLIND_M = 0.005  # travel without any heading that still counts as standing
AGREE_RAD = math.radians(2.0)  # turned by wheels and attitude over a gap: noise of both
ASKEW_RAD = 0.05  # a body that brakes or slips moves aside of where it points


class BlindWay:
    """The newest gap in the attitude, interval by interval of the wheels."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """No gap is known of."""
        self._way_m = self._turn_rad = self._net_rad = self._off_rad = self._hidden_m = 0.0
        self.step_m = 0.0  # position error that the newest interval may hide
        self.off_rad = 0.0  # heading in its middle by the wheels, less by the attitude

    @property
    def is_open(self) -> bool:
        """Whether the robot moved in a gap whose end has not been judged yet."""
        return self._way_m > BLIND_M

    def take(
        self, gap_s: float, travel_m: float, wheels_rad: float, turned_rad: float, *, sure: bool
    ) -> bool:
        """The next interval.

        Args:
            gap_s: between the attitudes about its middle.
            turned_rad: by the attitude, which is interpolated over a gap.
            sure: the attitude tells how it has turned by itself, without the wheels.

        Returns:
            Whether place or heading are lost.
        """
        if gap_s <= GAP_S:
            lost = self.is_open and not (sure and abs(self._off_rad) <= AGREE_RAD)
            self.restart()
            return lost
        self.off_rad = self._off_rad + (wheels_rad - turned_rad) / 2
        self._way_m += abs(travel_m)
        self._turn_rad += abs(wheels_rad)
        self._net_rad += wheels_rad
        self._off_rad += wheels_rad - turned_rad
        turned_back_rad = (self._turn_rad - abs(self._net_rad)) / 2
        self.step_m = abs(travel_m) * (AGREE_RAD + ASKEW_RAD + turned_back_rad)
        self._hidden_m += self.step_m
        return self._hidden_m > HIDDEN_M
