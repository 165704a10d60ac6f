"""Writes what libfreenect's recorder writes: a folder that its player gives as a Kinect.

    INDEX.txt                       names of files, in the order of playing
    d-SECONDS-STAMP.pgm             P5 640 480 65535, then raw values, little-endian
Source: kinect sheet, section 4.
"""

from collections.abc import Iterable
from pathlib import Path

from fakes.kinect.sensing import U16

BEGIN_S, STAMP_HZ = 1_290_000_000.0, 60_000_000


def write_dump(folder: Path, frames: Iterable[tuple[float, U16]]) -> None:
    """A new folder of frames.

    Args:
        frames: seconds after the first one, and raw values (480, 640).

    Raises:
        FileExistsError: the folder is there.
        ValueError: a frame of another size.
    """
    folder.mkdir(parents=True)
    names = []
    for t_s, raw in frames:
        if raw.shape != (480, 640):
            raise ValueError(f"frames are of 480 rows and 640 columns, is {raw.shape}")
        stamp = round(STAMP_HZ * t_s) % (1 << 32)
        names.append(f"d-{BEGIN_S + t_s:.6f}-{stamp}.pgm")
        data = b"P5 640 480 65535\n" + raw.astype("<u2").tobytes()
        (folder / names[-1]).write_bytes(data)
    (folder / "INDEX.txt").write_text("".join(f"{name}\n" for name in names), encoding="ascii")
