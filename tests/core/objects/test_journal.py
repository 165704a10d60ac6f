"""Versions and the index: a copy that follows the changes is the map, whatever was missed."""

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from core.objects.vector_map.index import BoxIndex
from core.objects.vector_map.journal import Changes, Journal, Shape, shape_of


def told(number: int, size: float) -> Shape:
    corners = np.array([[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]])
    return shape_of(number, "object", corners, 0.0, size)


class Copies(RuleBasedStateMachine):
    """A journal that forgets early, and copies that ask at any time."""

    def __init__(self) -> None:
        super().__init__()
        self.journal = Journal(kept_deletions=2)
        self.truth: dict[int, float] = {}
        self.next_id = 1
        self.copies: list[tuple[int, dict[int, Shape]]] = [(0, {}) for _ in range(3)]

    @rule(size=st.integers(1, 50))
    def add(self, size: int) -> None:
        self.journal.tell(told(self.next_id, size))
        self.truth[self.next_id] = size
        self.next_id += 1

    @rule(size=st.integers(1, 50), pick=st.integers(0, 100))
    def change(self, size: int, pick: int) -> None:
        if self.truth:
            number = sorted(self.truth)[pick % len(self.truth)]
            self.journal.tell(told(number, size))
            self.truth[number] = size

    @rule(pick=st.integers(0, 100))
    def delete(self, pick: int) -> None:
        if self.truth:
            number = sorted(self.truth)[pick % len(self.truth)]
            self.journal.delete(number)
            del self.truth[number]

    @rule(which=st.integers(0, 2))
    def ask(self, which: int) -> None:
        version, copy = self.copies[which]
        changes = self.journal.since(version)
        copy = self._applied({} if changes.is_whole else copy, changes)
        self.copies[which] = changes.version, copy
        assert {number: shape.top_mm for number, shape in copy.items()} == {
            number: round(1000 * size) for number, size in self.truth.items()
        }
        digest = 0
        for shape in copy.values():
            digest ^= shape.digest
        assert digest == changes.digest
        again = self.journal.since(changes.version)
        assert (again.changed, again.deleted) == ((), ()) or changes.version == 0

    def _applied(self, copy: dict[int, Shape], changes: Changes) -> dict[int, Shape]:
        copy = {n: shape for n, shape in copy.items() if n not in changes.deleted}
        return copy | {shape.id: shape for shape in changes.changed}

    @invariant()
    def versions_only_count_up(self) -> None:
        assert all(version <= self.journal.version for version, _ in self.copies)


TestCopies = Copies.TestCase


def test_a_version_that_never_was_is_refused() -> None:
    with pytest.raises(ValueError, match=r"version: must be within 0\.\.0, is 1"):
        Journal().since(1)


def test_the_index_finds_what_a_list_finds() -> None:
    random, index = np.random.default_rng(1), BoxIndex()
    boxes = dict[int, tuple[float, float, float, float]]()
    for step in range(400):
        number = int(random.integers(60))
        if random.random() < 0.3:
            index.remove(number)
            boxes.pop(number, None)
        low = random.uniform(-10, 10, 2)
        size = random.exponential(1.5 if step % 7 else 1e8, 2)  # 10^16 m2 have cells for no memory
        (x0, y0), (x1, y1) = low.tolist(), (low + size).tolist()
        box = x0, y0, x1, y1
        if step % 2:
            index.put(number, box)
            boxes[number] = box
        near = [
            n
            for n, b in boxes.items()
            if b[0] <= box[2] and b[2] >= box[0] and b[1] <= box[3] and b[3] >= box[1]
        ]
        assert index.near(box) == sorted(near)
