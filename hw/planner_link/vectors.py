"""What one planner is told besides its map: the objects of the vector map, and the path.

Off unless a source is given. A planner that only asks gets answers alone.
Source: planner link, sections 3 (OBJECTS, PATH), 6 and 7.
"""

from typing import Protocol

from core.records import PathReport
from hw.planner_link.messages import ASK_OBJECTS, ASK_PATH, Ack
from hw.planner_link.objects import ObjectPublisher, ObjectSource
from hw.planner_link.paths import PathPublisher
from hw.planner_link.scheduler import FrameScheduler


class VectorSource(Protocol):
    """Where objects and path come from."""

    @property
    def objects(self) -> ObjectSource | None:
        """None: nobody looks for objects here, and nothing is told of them."""

    @property
    def path(self) -> PathReport | None:
        """None: nobody plans here, and nothing is told of it."""


class Vectors:
    """Both, for one planner."""

    def __init__(self, scheduler: FrameScheduler) -> None:
        self._scheduler = scheduler
        self._objects, self._path = ObjectPublisher(scheduler), PathPublisher(scheduler)
        self._path_asked = False

    def begin_epoch(self, geom_id: int) -> None:
        """The planner holds nothing any more."""
        self._objects.begin_epoch(geom_id)
        self._path.begin_epoch(geom_id)

    def tell_again(self) -> None:
        """Nobody knows what the planner holds."""
        self._objects.tell_again()
        self._path.tell_again()

    def take(self, wants: int) -> None:
        """What an ASK wants; a round of the objects that is under way is not begun again."""
        if wants & ASK_OBJECTS and not self._objects.round_due:
            self._objects.tell_again()
        if wants & ASK_PATH:
            self._path.tell_again()
            self._path_asked = True

    def take_ack(self, newest: int, ack: Ack) -> None:
        """An ACK of frames of this epoch, `newest` unwrapped."""
        self._objects.take_ack(newest, ack)
        self._path.take_ack(newest, ack)

    def publish(
        self, now_s: float, budget: float, source: VectorSource | None, pushes: bool
    ) -> None:
        """Frames into the scheduler, under a budget of wire bytes; else answers alone."""
        floor = self._scheduler.budget.credit - budget
        objects = source.objects if source is not None else None
        path = source.path if source is not None else None
        if objects is not None:
            self._objects.follow(objects)
            publish = self._objects.publish if pushes else self._objects.publish_round
            publish(now_s, budget, objects.looked_s)
        if path is not None:
            self._path.follow(path)
            left = self._scheduler.budget.credit - floor
            if pushes:
                self._path.publish(now_s, left)
            elif self._path_asked:
                self._path.publish_wanted(now_s, left)
            self._path_asked &= self._path.waiting
