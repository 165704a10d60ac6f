"""Fuzzing of the C header: inputs to begin with, the fuzzer, and the long run.

`python -m tests.support.link.c_fuzz --seconds 600 --seed 1` runs coverage-guided until the time is
over; what it finds to be of use is kept in build/c/corpus.
"""

import argparse
import random
import struct
import subprocess
import sys
from pathlib import Path

from mapod_link.frames import OBJECTS, PATH
from tests.support.link.object_frames import gone_record, object_record, objects_body, path_body
from tests.support.link.planner_sender import VECTORS, vector
from tools.conformance.wire import (
    DIGEST,
    GEOM,
    MAP,
    POSE,
    STOP_ZONE,
    TILE,
    Geom,
    map_body,
    op,
    pose_body,
)
from tools.rig.planner.build import BUILD, MCU, SANITIZED, built

SOURCE = MCU / "host" / "fuzz.c"
TAGGED, BROKEN, NOISE, LATE = 0x10, 0x20, 0x80, 8  # ways to feed a piece, see fuzz.c


def build_fuzzer() -> Path:
    """For libFuzzer: only clang has it."""
    return built("fuzz", SOURCE, "-O1", *SANITIZED, "-fsanitize=fuzzer", compiler="clang")


def build_replayer(compiler: str) -> Path:
    """The same without a guide: takes the inputs that it is given."""
    return built("replay", SOURCE, "-O1", *SANITIZED, "-DFUZZ_MAIN", compiler=compiler)


def piece(frame_type: int, body: bytes, way: int = 1) -> bytes:
    """One frame as the fuzzer takes it: its head and CRC are made there."""
    frame = bytes([0x10 | frame_type]) + bytes(7) + body
    return bytes([way]) + struct.pack("<H", len(frame)) + frame


def random_ops(rng: random.Random) -> bytes:
    """Operations that mostly fit into a window of 30 x 30; numbers of some are cut off."""
    pieces = [
        bytes([rng.randrange(4) << 6 | 63, rng.choice([5, 0x80, 0xFF]), rng.randrange(4)])
        if rng.random() < 0.2
        else op(rng.randrange(4), rng.randint(1, 63))
        for _ in range(rng.randint(0, 12))
    ]
    return b"".join(pieces)


def random_vectors(rng: random.Random) -> tuple[int, bytes]:
    """Objects or a stretch of a path, sometimes with a byte that is wrong."""
    places = [(rng.randrange(-9000, 9000), rng.randrange(-9000, 9000)) for _ in range(12)]
    records = [
        object_record(rng.randrange(9), rng.randrange(1, 5), places[: rng.randint(3, 12)])
        for _ in range(rng.randrange(5))
    ]
    records.insert(0, gone_record(rng.randrange(9)))
    ids = rng.choice([(1, 0), (0, 4), (3, 2**32 - 1)])
    first, number = rng.randrange(30), rng.randint(1, 3)
    kind, body = rng.choice(
        [
            (OBJECTS, objects_body(records, records, ids=ids)),
            (PATH, path_body(places, number=number, first=first, total=41)),
        ]
    )
    wrong = bytearray(body)
    wrong[rng.randrange(len(body))] ^= rng.choice([0, 0, 0, 255])
    return kind, bytes(wrong)


def random_input(seed: int) -> bytes:
    """A conversation with valid frames of arbitrary bodies, noise and damage."""
    rng = random.Random(seed)
    tagged = TAGGED * rng.randrange(2)
    width = rng.randint(1, 30)
    pieces = [piece(GEOM, Geom(7, width, rng.randint(1, 30), 0x5A17C0DE).body(), 1 | tagged)]
    ox, oy = rng.randrange(-32768, 32768), 32766
    for _ in range(rng.randint(5, 40)):
        ox, oy = ox + rng.randint(-3, 3), oy + rng.randint(-2, 2)
        start, repaired = rng.randrange(width * 2), rng.randrange(65536)
        cells = map_body((ox, oy), repaired, 7, start, random_ops(rng))
        kind, body = rng.choice(
            [
                (MAP, cells),
                (MAP, cells),
                (POSE, pose_body()),
                (rng.randrange(16), rng.randbytes(rng.choice([0, 8, 16, 20, 24, 40, 200, 356]))),
                (TILE, rng.randbytes(2) + bytes([rng.randrange(5), 0]) + rng.randbytes(30)),
                (DIGEST, b"\7\0\0\0" + rng.randbytes(4)),
                (STOP_ZONE, rng.randbytes(20)),
                random_vectors(rng),
            ]
        )
        way = rng.choice([1, 1, 1, 2, 5, BROKEN | 1, NOISE | 1, LATE | 1, 0x41]) | tagged
        pieces.append(piece(kind, body, way))
    return b"".join(pieces)


def seeds() -> list[bytes]:
    """The protocol's own frames, in one conversation and each after GEOM, plain and with tags."""
    small = piece(GEOM, Geom(7, 30, 30, 0x5A17C0DE).body())
    frames = [vector(name) for name in VECTORS if f"{name}_serial" in VECTORS]
    single = [piece(frame[0] & 15, frame[8:-4]) for frame in frames]
    tagged = [bytes([each[0] | TAGGED]) + each[1:] for each in (small, *single)]
    return [
        small + b"".join(single),
        b"".join(tagged),
        *(small + each for each in single),
        *(random_input(seed) for seed in range(8)),
    ]


def write_inputs(folder: Path, inputs: list[bytes]) -> None:
    """One file each."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, content in enumerate(inputs):
        (folder / f"seed-{k:04d}").write_bytes(content)


def fuzz(corpus: Path, *limits: str) -> subprocess.CompletedProcess[str]:
    """Run the fuzzer in a corpus that has the seeds in it."""
    write_inputs(corpus, seeds())
    command = [str(build_fuzzer()), "-max_len=1500", "-print_final_stats=1", *limits, str(corpus)]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=corpus.parent)


def main() -> int:
    """The long run; 0 if nothing was found."""
    arguments = argparse.ArgumentParser(description="fuzz the C header of the planner link")
    arguments.add_argument("--seconds", type=int, default=600)
    arguments.add_argument("--seed", type=int, default=1)
    chosen = arguments.parse_args()
    limits = (f"-max_total_time={chosen.seconds}", f"-seed={chosen.seed}")
    done = fuzz(BUILD / "corpus", *limits)
    sys.stdout.write(done.stderr[-3000:])
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
