"""What stands in the bodies of GEOM and MAP frames, read slowly and obviously, for the model.

Source: planner link, section 3 (docs/planner-link.md).
"""

import struct

from tools.conformance.wire import DIGEST, GEOM, MAP, POSE, STOP_ZONE, Geom

LENGTHS = {GEOM: 16, POSE: 24, DIGEST: 8, STOP_ZONE: 20}
Run = tuple[int, int, int]  # state, first cell, cell after the last


class SlowBodies:
    """The reading half of `SlowReceiver`."""

    geom: Geom | None
    max_cells: int

    def has_right_length(self, kind: int, body: bytes) -> bool:
        """Of those bodies that have but one, and of the head of a MAP."""
        return len(body) == LENGTHS.get(kind, len(body)) and (kind != MAP or len(body) >= 10)

    def maybe_geom(self, body: bytes) -> Geom | None:
        """None if it tells no window that fits."""
        if len(body) != 16:
            return None
        geom_id, _, width, height, cell_mm = struct.unpack_from("<BBHHH", body)
        session, tick_ms, stale_ms = struct.unpack_from("<IHH", body, 8)
        if not width * height * cell_mm or width * height > self.max_cells:
            return None
        return Geom(geom_id, width, height, session, stale_ms, tick_ms, cell_mm)

    def maybe_runs(self, body: bytes) -> list[Run] | None:
        """What the operations of a MAP body do; None if they do not fit."""
        assert self.geom is not None
        if len(body) < 10:
            return None
        cursor, at = int.from_bytes(body[7:10], "little"), 10
        runs: list[Run] = []
        while at < len(body):
            state, run = body[at] >> 6, (body[at] & 63) + 1
            at += 1
            if run == 64:
                number = self.maybe_leb128(body, at)
                if number is None:
                    return None
                run, at = self.long_run(number[0]), number[1]
            if cursor + run > self.geom.width * self.geom.height:
                return self.rest_of_bad_runs(runs)
            runs.append((state, cursor, cursor + run))
            cursor += run
        return runs

    def rest_of_bad_runs(self, runs: list[Run]) -> list[Run] | None:
        """What is left of a MAP frame whose operations pass the last cell: nothing."""
        return None

    def long_run(self, number: int) -> int:
        """Cells of an operation with a LEB128 number."""
        return 64 + number

    def maybe_leb128(self, body: bytes, at: int) -> tuple[int, int] | None:
        """The number and where it ends; None if it is cut off or has a fourth byte."""
        number = 0
        for k in range(3):
            if at + k >= len(body):
                return None
            number |= (body[at + k] & 0x7F) << 7 * k
            if body[at + k] < 0x80:
                return number, at + k + 1
        return None
