"""Saved maps as files, of the ground and of objects: read and checked before the run.

They are written whole or not at all: that of the ground beside the loop, that of objects last.
"""

import os
import stat
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app import App
from core.config import Config
from core.saved.check import check_state
from core.saved.encoding import Arrays, StateError, arrays_from_bytes, bytes_from_arrays
from core.saved.state import state_of, was_moving
from hw.runtime.threads import Worker
from logs import LOG

if TYPE_CHECKING:
    from beside import Beside
    from core.objects.look import FrameLook
    from core.objects.seen import Seen
    from core.objects.vector_map.geojson import SavedMap

NO_CAMERA = "the settings have no [depth] camera, which sees objects"
MOST_BYTES = 1_000_000_000  # of a saved map: more than of the largest that settings allow


def read_whole(path: str, most_bytes: int) -> bytes:
    """Raises OSError, StateError: it is no file, or too long."""
    with Path(path).open("rb") as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            raise StateError("it is no file on a disk")
        if status.st_size > most_bytes:
            raise StateError(f"it must have at most {most_bytes} bytes, has {status.st_size}")
        return file.read()


def load_map(path: str, config: Config) -> Arrays:
    """The state of a map in a file, or StateError: not read, damaged, or of other settings."""
    try:
        arrays = arrays_from_bytes(read_whole(path, MOST_BYTES))
        check_state(arrays, config)
    except (OSError, StateError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise StateError(f"can't load the map {path!r}: {reason}") from None
    return arrays


def write_whole(path: str, content: bytes) -> None:
    """Into a file, whole or not at all: what was there before stays until then."""
    part = Path(f"{path}.part")
    with part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


def write_map(path: str, arrays: Arrays) -> None:
    """A state into a file."""
    write_whole(path, bytes_from_arrays(arrays))


class MapSaver:
    """Saves an app's map into a file, beside the loop; where it can't, the log says why."""

    def __init__(self, app: App, path: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._app, self._path, self._clock = app, path, clock
        self._writer = Worker()
        self._writing: Future[None] | None = None

    def save(self) -> None:
        """Save the map as it is now; the file is written meanwhile."""
        if self._writing is not None and not self._writing.done():
            LOG.warning("map_not_saved", reason="the one before is still being written")
        elif (arrays := self._maybe_state()) is not None:
            self._begin(arrays)

    def finish(self) -> None:
        """Save for the last time, the map as it is now; all is written afterwards."""
        arrays = self._maybe_state()  # at once: nobody reads the sensors any more
        if arrays is not None:
            self._begin(arrays)
        if self._writing is not None:
            self._writing.result()

    def _maybe_state(self) -> Arrays | None:
        try:
            return state_of(self._app.mapper, self._app.config, self._clock())
        except StateError as error:
            LOG.warning("map_not_saved", reason=str(error))
            return None

    def _begin(self, arrays: Arrays) -> None:
        self._writing = self._writer.submit(partial(self._write, arrays))

    def _write(self, arrays: Arrays) -> None:
        try:
            write_map(self._path, arrays)
        except OSError as error:
            LOG.warning("map_not_saved", reason=str(error))
        else:
            LOG.info("map_saved", file=self._path, moving=was_moving(arrays))


def load_objects(path: str, config: Config) -> "SavedMap":
    """A map that was saved, of the same settings, or anybody's floor plan; or StateError."""
    if config.object_map is None or not config.has_camera:
        raise StateError(f"--load-objects: {NO_CAMERA}")
    from core.objects.vector_map import geojson  # polygons: for who has a depth camera

    try:
        text = read_whole(path, geojson.MOST_BYTES).decode("utf-8")
        return geojson.map_from_text(text, config.object_map, config.robot.height_m)
    except UnicodeDecodeError:
        reason: object = "it is no text in UTF-8"
    except OSError as error:
        reason = error.strerror
    except (StateError, geojson.GeoJsonError) as error:
        reason = error
    raise StateError(f"can't load the objects {path!r}: {reason}")


class ObjectsSaver:
    """Saves what a look at frames has found into a file; where it can't, the log says why."""

    def __init__(self, look: "FrameLook", frames: "Beside[Seen]", path: str) -> None:
        self._look, self._frames, self._path = look, frames, path

    def finish(self) -> None:
        """After the last frame that is still looked at."""
        saving: Callable[[], None] = self._save
        self._frames.after(saving)

    def _save(self) -> None:
        text, count = self._look.as_geojson()
        try:
            write_whole(self._path, text.encode())
        except OSError as error:
            LOG.warning("objects_not_saved", reason=str(error))
        else:
            LOG.info("objects_saved", file=self._path, objects=count)
