"""A film of a drive: pictures of the map, one behind the other, as H.264 in MP4. Needs PyAV."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
from PIL import Image

FRAME: Any = av.VideoFrame  # its methods have no types

CODECS = ("libx264", "h264", "mpeg4")  # the first that this build of FFmpeg has
CRF = "20"  # how exact: of libx264, smaller is better


class Film:
    """A film on disk. Raises OSError: it can't be written."""

    def __init__(self, path: Path, frames_per_s: float) -> None:
        self.pictures = 0
        self._rate = Fraction(frames_per_s).limit_denominator(1000)
        self._file: Any = av.open(str(path), "w", format="mp4")
        self._stream: Any = None

    def add(self, picture: Image.Image) -> None:
        """One more picture, of the same size as all others; its sides are even."""
        if self._stream is None:
            self._begin(picture)
        for packet in self._stream.encode(FRAME.from_image(picture)):
            self._file.mux(packet)
        self.pictures += 1

    def close(self) -> None:
        if self._stream is not None:
            for packet in self._stream.encode():
                self._file.mux(packet)
        self._file.close()

    def _begin(self, picture: Image.Image) -> None:
        codec = next(name for name in CODECS if name in av.codecs_available)
        options = {"crf": CRF} if codec == "libx264" else {}
        self._stream = self._file.add_stream(codec, rate=self._rate, options=options)
        self._stream.width, self._stream.height = picture.size
        self._stream.pix_fmt = "yuv420p"
