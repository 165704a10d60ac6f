"""Saved maps as files: read and checked before the run, written beside the loop, whole or not."""

import os
import stat
import time
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path

from app import App
from core.config import Config
from core.saved.check import check_state
from core.saved.encoding import Arrays, StateError, arrays_from_bytes, bytes_from_arrays
from core.saved.state import state_of, was_moving
from hw.runtime.threads import Worker
from logs import LOG

MOST_BYTES = 1_000_000_000  # of a saved map: more than of the largest that settings allow


def load_map(path: str, config: Config) -> Arrays:
    """The state of a map in a file, or StateError: not read, damaged, or of other settings."""
    try:
        with Path(path).open("rb") as file:
            status = os.fstat(file.fileno())
            if not stat.S_ISREG(status.st_mode):
                raise StateError("it is no file on a disk")
            if status.st_size > MOST_BYTES:
                raise StateError(f"it must have at most {MOST_BYTES} bytes, has {status.st_size}")
            arrays = arrays_from_bytes(file.read())
        check_state(arrays, config)
    except (OSError, StateError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise StateError(f"can't load the map {path!r}: {reason}") from None
    return arrays


def write_map(path: str, arrays: Arrays) -> None:
    """A state into a file, whole or not at all: what was there before stays until then."""
    part = Path(f"{path}.part")
    with part.open("wb") as file:
        file.write(bytes_from_arrays(arrays))
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


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
