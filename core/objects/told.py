"""The objects as planners are told of them, by version: what frames said, put together.

Source: planner link, section 3 (OBJECTS).
"""

import math
from collections import OrderedDict

from core.objects.seen import Seen
from core.records import ObjectChanges, ObjectReport

KEPT_DELETIONS = 4096  # nobody asks from further back: links ask at each of their ticks


class ToldObjects:
    """A source of objects; each frame is a version."""

    def __init__(self) -> None:
        self.version, self.looked_s = 0, -math.inf
        self._told = OrderedDict[int, tuple[int, ObjectReport]]()  # by id; the newest change last
        self._gone = OrderedDict[int, int]()  # id: version

    def take(self, seen: Seen) -> None:
        """A frame without a doubt."""
        self.version, self.looked_s = self.version + 1, seen.t_s
        for number in seen.gone:
            self._remove(number)
        for report in seen.changed:
            self._gone.pop(report.id, None)
            self._told[report.id] = self.version, report
            self._told.move_to_end(report.id)

    def clear(self) -> None:
        """Nobody knows any more where they are."""
        self.version, self.looked_s = self.version + 1, -math.inf
        for number in list(self._told):
            self._remove(number)

    def reports(self) -> list[ObjectReport]:
        """All that there are, by id."""
        return [self._told[number][1] for number in sorted(self._told)]

    def changes(self, since: int) -> ObjectChanges:
        """What is different from an older version; since -1: all objects that there are."""
        if since < 0:
            return ObjectChanges(tuple(self.reports()), ())
        changed = []
        for version, report in reversed(self._told.values()):
            if version <= since:
                break
            changed.append(report)
        gone = tuple(number for number, version in self._gone.items() if version > since)
        return ObjectChanges(tuple(changed), gone)

    def _remove(self, number: int) -> None:
        if self._told.pop(number, None) is not None:
            self._gone[number] = self.version
        if len(self._gone) > KEPT_DELETIONS:
            self._gone.popitem(last=False)
