"""What the beams of the newest scans met, and whether they see at all. No I/O, no clock.

A code instead of a range is never free space: the map takes such a beam for one that was not sent.
Here codes are only counted, for a person. Source: urg04lx sheet, section 6.
"""

import numpy as np

from core.records import F64

KINDS = {  # of error codes, by what they mean for who looks
    "beyond its range": (0,),
    "too little light": (1, 2),
    "neighbours disagree": (7, 8),
    "not the same twice": (9,),
    "too much light": (18,),
    "not measurable": (19,),
}
BEYOND, OTHERS = "beyond its range", "for other reasons"
NEWEST_SHARE, LEAST_SHARE = 0.1, 0.05  # weight of the newest scan; of beams, below it is doubt


class Sight:
    """One scanner's.

    A beam sees if it has a range, or may have met nothing within it: in the open all do.
    """

    def __init__(self) -> None:
        self._raw: F64 = np.zeros(0)  # of the newest scan, as the device sent it
        self._least = self._most = 0.0  # what is a range
        self._share: float | None = None  # of beams that see: its mean

    def look(self, raw: F64, least: float, most: float, ranges: int) -> None:
        """Take in a scan; ranges: how many of its beams have one."""
        self._raw, self._least, self._most = raw, least, most
        share = ranges / max(1, raw.size)
        if share < LEAST_SHARE:
            share += np.count_nonzero((raw == 0) | (raw > most)) / max(1, raw.size)
        last = share if self._share is None else self._share
        self._share = last + NEWEST_SHARE * (share - last)

    def invalid(self) -> dict[str, int]:
        """How many beams of the newest scan have no range, by what their codes mean."""
        raw = self._raw
        counts = {kind: int(np.isin(raw, codes).sum()) for kind, codes in KINDS.items()}
        counts[BEYOND] += int(np.count_nonzero(raw > self._most))
        invalid = int(np.count_nonzero((raw < self._least) | (raw > self._most)))
        counts[OTHERS] = invalid - sum(counts.values())
        return {kind: count for kind, count in counts.items() if count}

    @property
    def doubt(self) -> str:
        """Why nobody may drive by it, in words; "" if all is well."""
        if self._share is None or self._share >= LEAST_SHARE:
            return ""
        counts = self.invalid()
        why = max(counts, key=counts.__getitem__, default=OTHERS)
        return f"the scanner's beams tell no range ({why}): is it covered, or dazzled?"
