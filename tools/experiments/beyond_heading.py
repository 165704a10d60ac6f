"""Beyond the paper: a heading sensor that a steel door disturbs by 40 degrees."""

import math
from dataclasses import replace
from pathlib import Path

from core.geometry import wrapped
from fakes.world.magnetic import MagneticDisturbance
from fakes.world.trajectory import Way, stand, straight
from tools.experiments import metrics
from tools.experiments.report import Outcome
from tools.experiments.scenes import corridor, scene
from tools.experiments.trial import BOTH, LEAD_S, Trial, methods

EVERY_S = 0.2
DOOR = MagneticDisturbance(
    "steel door", (6.0, 1.2), math.radians(40.0) / math.exp(-((1.2 / 1.5) ** 2))
)
NOTE = (
    "12 m at 0.5 m/s past steel that turns the horizontal field by 40 deg, and makes it "
    "stronger, where the robot is nearest to it. Heading and place of reference_plane: as "
    "the sensor's own heading has them, which the paper follows; its maps here get the "
    "filtered heading as those of beams do."
)


class Compass:
    """The heading that the sensor itself tells, which the paper's method would follow.

    It is pulled towards the disturbed field with the sensor's time constant; noise is left out.
    """

    def __init__(self, test: Trial) -> None:
        self._test, self._was_s, self._was_x_m = test, 0.0, 0.0
        self.off_rad = self.worst_rad = self.aside_m = 0.0

    def look(self) -> None:
        """Once more; also lays the way since the last look along that heading."""
        rig, now_s = self._test.rig, self._test.now_s
        turned = rig.world.distortion_at(now_s) @ rig.ahrs.earth_field
        wrong_rad = math.atan2(turned[1], turned[0])
        dt_s = min(EVERY_S, now_s - self._was_s)
        self.off_rad += (1.0 - math.exp(-dt_s / rig.ahrs.pull_s)) * (wrong_rad - self.off_rad)
        self.worst_rad = max(self.worst_rad, abs(self.off_rad))
        x_m = rig.world.pose()[0]
        self.aside_m += (x_m - self._was_x_m) * math.sin(self.off_rad)
        self._was_s, self._was_x_m = now_s, x_m


def steel_door(quick: bool, folder: Path) -> Outcome:
    way = Way(stand(LEAD_S), straight(12.0, 1.0 if quick else 0.5))
    place = replace(scene("corridor", corridor(28.37)), steels=(DOOR,))
    test = Trial(place, way, methods(quick), x_m=(-8.0, 34.0))
    worst = dict.fromkeys(test.apps, 0.0)
    compass = Compass(test)

    def look() -> None:
        compass.look()
        true_rad = test.rig.world.pose()[2]
        for view in test.views():
            off_deg = math.degrees(abs(wrapped(view.pose[2] - true_rad)))
            worst[view.name] = max(worst[view.name], off_deg)

    test.run(way.duration_s + 0.2, EVERY_S, look)
    x_m, y_m = test.rig.world.pose()[:2]
    place_cm = {
        view.name: 100.0 * math.hypot(view.pose[0] - x_m, view.pose[1] - y_m)
        for view in test.views()
    }
    worst["reference_plane"] = math.degrees(compass.worst_rad)
    place_cm["reference_plane"] = 100.0 * abs(compass.aside_m)
    outcome = Outcome("7 steel door, 40 deg", NOTE)
    outcome.tell("error of heading, most, deg", worst, digits=1)
    outcome.tell("error of place at the end, cm", place_cm, digits=0)
    walls_cm = test.per_app(lambda view, cells: 100.0 * metrics.wall_error_m(view, cells))
    outcome.tell("position error of walls, mean cm", walls_cm, digits=1)
    outcome.tell("false obstacle cells", test.per_app(metrics.false_obstacles), digits=0)
    caption = "7: past a steel door that turns the compass by 40 degrees"
    outcome.draw(folder / "7-steel-door.png", caption, test.views(*BOTH), (-1, 23), (-4, 4))
    return outcome
