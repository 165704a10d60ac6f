"""Plays a replay from instant to instant, at a pace, and keeps what its pictures need."""

import gc
import math
import time
from collections.abc import Callable

from tools.replay.outcome import Replay, Tally

TRACK_HZ = 5.0  # points of the path, of the replay's time
LOOK_HZ = 20.0  # how often whoever looks on is asked, likewise

Point = tuple[float, float]


class Playing:
    """One replay on its way.

    Attributes:
        path: where the robot was so far, (x, y) metres in the map frame.
        took_s: CPU time of this process so far.
    """

    def __init__(self, replay: Replay) -> None:
        self.replay = replay
        self.tally, self.path = Tally(), list[Point]()
        self.took_s = 0.0
        self._tracked_s = self._looked_s = -math.inf

    def play_to(
        self,
        t_s: float,
        speed: float = math.inf,
        look: Callable[["Playing"], None] = lambda playing: None,
        look_s: float = 1 / LOOK_HZ,
    ) -> None:
        """All turns up to this instant.

        Args:
            speed: times the pace at which it was recorded; inf: as fast as it goes.
            look: is called this often, by the replay's time.

        Raises:
            RecordingError: it is damaged from here on.
        """
        replay, tally = self.replay, self.tally
        begun_s, zero_s, cpu_s = time.monotonic(), replay.next_s, time.process_time()
        gc.disable()  # as while a robot runs: the app makes no circles
        try:
            while not replay.done and replay.next_s <= t_s:
                if speed < math.inf:
                    waits_s = (replay.next_s - zero_s) / speed - (time.monotonic() - begun_s)
                    time.sleep(max(0.0, waits_s))
                replay.step()
                if replay.frames:
                    tally.take(replay.frames)
                if replay.now_s - self._tracked_s >= 1 / TRACK_HZ:
                    self._track()
                if replay.now_s - self._looked_s >= look_s:
                    self._looked_s = replay.now_s
                    look(self)
        finally:
            gc.enable()
            self.took_s += time.process_time() - cpu_s

    def _track(self) -> None:
        self._tracked_s = self.replay.now_s
        pose = self.replay.app.mapper.odometry.maybe_pose(self.replay.now_s)
        if pose is not None:
            self.path.append((pose.x_m, pose.y_m))
