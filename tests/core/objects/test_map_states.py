"""Things come and go as hypothesis wants; what must hold after every frame."""

import math

import numpy as np
import shapely
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from core.objects.vector_map.journal import Shape
from core.objects.vector_map.object_map import MapUpdate, ObjectMap
from tools.experiments.object_world import SETTINGS, Noise, Thing, World, apart_m, box, person

PLACES = st.tuples(st.integers(-2, 2), st.integers(2, 6))
TOLD_M = 0.15  # so near a thing its polygon or an obstacle is


class Life(RuleBasedStateMachine):
    """A camera at the middle; things stand on a grid around it, people walk."""

    def __init__(self) -> None:
        super().__init__()
        self.world = World([], noise=Noise(0.01, 0.003, 0.004), rays=256)
        self.objects = ObjectMap(SETTINGS)
        self.yaw = 0.0
        self.there: dict[tuple[int, int], Thing] = {}
        self.people: list[Thing] = []
        self.copy: dict[int, Shape] = {}
        self.version = 0
        self.ever, self.gone = set[int](), set[int]()

    @rule(place=PLACES, size=st.sampled_from([0.15, 0.3, 0.5]))
    def put(self, place: tuple[int, int], size: float) -> None:
        angle, distance = 0.25 * place[0], 0.6 * place[1]
        x, y = distance * math.cos(angle), distance * math.sin(angle)
        self.there[place] = box(x, y, size, size, angle)

    @rule(pick=st.integers(0, 50))
    def take(self, pick: int) -> None:
        if self.there:
            del self.there[sorted(self.there)[pick % len(self.there)]]

    @rule(x=st.floats(1.0, 4.0), vy=st.floats(0.4, 1.2))
    def walker(self, x: float, vy: float) -> None:
        self.people = [person(x, -0.8 * x, 0.0, vy)]

    @rule(yaw=st.sampled_from([-0.3, 0.0, 0.4, math.pi]))
    def turn(self, yaw: float) -> None:
        self.yaw = yaw

    @rule(frames=st.integers(1, 30))
    def look(self, frames: int) -> None:
        for _ in range(frames):
            self.world.things = [*self.there.values(), *self.people]
            before = {one.id: one.polygon for one in self.objects.objects()}
            frame = self.world.frame(0.0, 0.0, self.yaw)
            update = self.objects.update(frame)
            self.what_is_seen_is_told(update)
            self.what_is_out_of_view_stays(before, frame.view)
            self.a_copy_is_the_map()
            self.world.walk()

    def what_is_seen_is_told(self, update: MapUpdate) -> None:
        told = [one.polygon for one in self.objects.objects()]
        told += [one.polygon for one in update.obstacles]
        for k, thing in enumerate(self.world.things):
            if (self.world.hits == k).sum() > 20:
                assert min((apart_m(thing.outline, one) for one in told), default=9.0) < TOLD_M

    def what_is_out_of_view_stays(self, before: dict[int, np.ndarray], view: np.ndarray) -> None:
        now = {one.id for one in self.objects.objects()}
        seen = shapely.Polygon(view).buffer(0.02)
        for number, polygon in before.items():
            assert number in now or seen.intersects(shapely.Polygon(polygon))

    def a_copy_is_the_map(self) -> None:
        changes = self.objects.changes_since(self.version)
        copy = {} if changes.is_whole else self.copy
        copy = {n: shape for n, shape in copy.items() if n not in changes.deleted}
        self.copy = copy | {shape.id: shape for shape in changes.changed}
        self.version = changes.version
        objects = {one.id: one.polygon for one in self.objects.objects()}
        assert objects.keys() == self.copy.keys()
        for number, polygon in objects.items():
            far = shapely.Polygon(polygon).hausdorff_distance(
                shapely.Polygon(self.copy[number].corners_mm / 1000.0)
            )
            assert far <= math.sqrt(2.0) * (SETTINGS.publish_m + 0.001)
        self.gone |= self.ever - objects.keys()
        assert not self.gone & objects.keys()
        self.ever |= objects.keys()


TestLife = Life.TestCase
TestLife.settings = settings(max_examples=15, stateful_step_count=12)
