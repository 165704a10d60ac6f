"""Conformance test 2: random maps, sizes, origins and moves, with frames that get lost."""

from tools.conformance.exam import BATCH, Exam
from tools.conformance.wire import (
    DIGEST,
    DIGEST_OK,
    FREE,
    GEOM,
    KEEP,
    MAP,
    NEED_FULL,
    OBSTACLE,
    POSE,
    REFRESH,
    UNKNOWN,
    digest_body,
    map_body,
    op,
    pose_body,
)

LOSS = 0.05
EDGES = [-32768, 32767, 0, -1, 32700, -32700]  # where the endless grid wraps
LENGTHS = (62, 63, 64, 65, 127, 128, 191, 192, 193, 320, 16_447, 16_448)  # where codes grow longer
STATES = (UNKNOWN, FREE, OBSTACLE, KEEP)


def digests(exam: Exam) -> str:
    """2: a DIGEST of another map must not be taken for that of this one."""
    exam.needs_map()
    if not exam.has_digest:
        return "cells are seen directly; the receiver compares no DIGEST"
    for width, height in [(3, 3), (5, 4), (9, 7)]:
        exam.begin(width, height)
        exam.tell([(FREE, width * height - 2), (OBSTACLE, 2)])
        exam.check("a DIGEST of the map")
        other = exam.model.window()
        other[-1, -1] = FREE
        exam.send(exam.next(DIGEST, digest_body(exam.geom.geom_id, other)))
        bits = DIGEST_OK | (NEED_FULL if exam.strict else 0)
        told = exam.ask().status & bits
        exam.expect("a DIGEST of another map: NEED_FULL and not DIGEST_OK", bits & NEED_FULL, told)
        told = exam.check("a DIGEST of the map again").status & bits
        exam.expect("a DIGEST that agrees again: DIGEST_OK and not NEED_FULL", DIGEST_OK, told)
    return "right ones and wrong ones, of 9 to 63 cells"


def random_maps(exam: Exam) -> str:
    """2: the receiver's map equals the model's, which saw the same frames."""
    exam.needs_map()
    frames = 0
    for k in exam.rounds(60):
        width, height = _size(exam, k)
        exam.begin(width, height)
        corner = (_near_edge(exam), _near_edge(exam))
        for _ in range(3):
            corner = _batch(exam, corner)
            frames += BATCH
            exam.check(f"{width} x {height} cells near {corner}")
            exam.tell([])
            exam.check(f"{width} x {height} cells near {corner}, and all repaired")
    return f"{frames} frames, {LOSS:.0%} of them lost, {k + 1} sizes"


def wraps(exam: Exam) -> str:
    """2: what stays in the window stays, where the endless grid wraps, and what leaves is gone."""
    exam.needs_map()
    for i, j in ((1, 0), (0, 1), (-1, 0), (0, -1), (2, -3)):
        corner = 32_767 if i >= 0 else -32_768, 32_767 if j >= 0 else -32_768
        exam.begin(9, 7)
        exam.send(exam.next_map([(FREE, 40), (OBSTACLE, 23)], origin=corner))
        for step in (1, 2, 3, -3, -1):
            corner = corner[0] + step * i, corner[1] + step * j
            exam.send(exam.next_map([], origin=corner))
            exam.check(f"the window at {corner}")
    return "to and fro over +-32 768, in x, in y and both"


def long_runs(exam: Exam) -> str:
    """2: runs of all lengths of their code do what they say, no cell more, also those that keep."""
    exam.needs_map()
    side = exam.side(130)
    cells = side * side
    lengths = [n for n in LENGTHS if n <= cells - 2]
    for state in (KEEP, UNKNOWN, OBSTACLE):
        exam.begin_free(side, side)
        for n in lengths:
            start = exam.random.randint(0, cells - n - 2)
            exam.tell([(OBSTACLE, 1), (state, n), (OBSTACLE, 1)], start)
            exam.check(f"a run of {n} cells of state {state} over known ones")
    return f"runs of {lengths[0]} to {lengths[-1]} cells over known ones"


def _size(exam: Exam, k: int) -> tuple[int, int]:
    """Width and height: the smallest, the largest, long ones, and any."""
    most = exam.max_cells
    side = min(401, int(most**0.5))
    shapes = [(3, 3), (63, 4), (3, side), (side, 3), (4, 65), (101, 101), (side, side)]
    if k % 10 == 9 or k < len(shapes):
        width, height = shapes[k % len(shapes)]
    else:
        top = 60 if exam.random.random() < 0.8 else 401
        width, height = exam.random.randint(3, top), exam.random.randint(3, top)
    while width * height > most:
        width, height = max(3, width // 2), max(3, height // 2)
    return width, height


def _near_edge(exam: Exam) -> int:
    return exam.random.choice(EDGES) + exam.random.randint(-5, 5)


def _batch(exam: Exam, corner: tuple[int, int]) -> tuple[int, int]:
    """Frames of which some get lost, while the window moves; gives its lowest corner."""
    for _ in range(BATCH):
        corner = _moved(exam, corner)
        cells = exam.geom.width * exam.geom.height
        start = exam.random.randrange(cells)
        repaired = exam.seq - exam.random.choice([0, 0, 1, 2, 5, 33, 300, 0x7FFF])
        body = map_body(corner, repaired, exam.geom.geom_id, start, _ops(exam, cells - start))
        data = exam.next(MAP, body, exam.random.choice([0, 0, REFRESH]))
        kind = exam.random.random()
        if kind < 0.1:
            data = exam.next(POSE, pose_body(exam.random.randint(-(2**31), 2**31 - 1)))
        elif kind < 0.13:
            data = exam.next(GEOM, exam.geom.body())
        if exam.random.random() >= LOSS:
            exam.send(data)
    exam.origin = corner
    return corner


def _moved(exam: Exam, corner: tuple[int, int]) -> tuple[int, int]:
    """Mostly little, sometimes by about the window's own size, or far."""
    i, j = corner
    width, height = exam.geom.width, exam.geom.height
    match exam.random.randrange(14):
        case 0 | 1 | 2 | 3:
            return i + exam.random.randint(-2, 2), j + exam.random.randint(-2, 2)
        case 4:
            return i + exam.random.choice([-1, 1]) * (width - exam.random.randint(0, 2)), j
        case 5:
            return i, j + exam.random.choice([-1, 1]) * (height - exam.random.randint(0, 2))
        case 6:
            return i + exam.random.randint(-32768, 32767), j + exam.random.randint(-32768, 32767)
        case _:
            return corner


def _ops(exam: Exam, room_cells: int) -> bytes:
    """Operations that fit into so many cells: short and long runs, short and long numbers."""
    ops, most = b"", exam.max_frame - 22 - (8 if exam.key else 0)
    wanted = exam.random.choice([0, 1, 3, 10, 60, 346])
    for _ in range(wanted):
        longest = exam.random.choice([1, 3, 62, 63, 64, 65, 191, 192, 400, 20_000, 200_000])
        run = exam.random.randint(max(1, longest - 2), longest)
        if run > room_cells:
            run = room_cells if exam.random.random() < 0.05 else 1
        leb_bytes = exam.random.choice([0, 0, 0, 2, 3]) if run > 63 else 0
        one = op(exam.random.choice(STATES), run, leb_bytes) if 0 < run <= room_cells else b""
        if not one or len(ops) + len(one) > most:
            break
        ops, room_cells = ops + one, room_cells - run
    return ops
