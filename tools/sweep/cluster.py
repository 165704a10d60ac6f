"""Jobs on a Dask cluster, whose workers can read the same paths and have the same mapod.

A worker that is lost loses what it was doing to another one; a job that loses several workers is
told as failed. `distributed` is imported only here, and only when it is asked for.
"""

import logging
import traceback
import uuid
from collections.abc import Callable, Generator, Sequence
from typing import Any, TypeVar

from tools.sweep.jobs import Failure, SchedulerError

T = TypeVar("T")
R = TypeVar("R")
WAIT_S = 30.0  # for the scheduler, and for its first worker
LACKING = "--scheduler needs the extra 'sweep': pip install 'mapod[sweep]'"


class DaskCluster:
    """The cluster at a scheduler's address, such as tcp://10.0.0.7:8786."""

    def __init__(self, address: str) -> None:
        self._address = address

    def results(
        self, work: Callable[[T], R], tasks: Sequence[T]
    ) -> Generator[tuple[int, R | Failure], None, None]:
        """Each task's place and result, once, as they end.

        Raises:
            SchedulerError: the library lacks, nobody answers there, no worker came, or it went.
        """
        if not tasks:
            return
        client = _client(self._address)
        run = uuid.uuid4().hex  # nobody else's results
        try:
            names = [f"mapod-{run}-{at}" for at in range(len(tasks))]
            futures = client.map(work, tasks, key=names, pure=False)
            places = {name: at for at, name in enumerate(names)}
            yield from self._as_they_end(client, futures, places)
        finally:
            client.close(timeout=5)

    def _as_they_end(
        self, client: Any, futures: list[Any], places: dict[str, int]
    ) -> Generator[tuple[int, Any], None, None]:
        from distributed import CancelledError, as_completed

        gone = SchedulerError(f"the scheduler at {self._address} is gone; what was done is kept")
        try:
            for future in as_completed(futures, loop=client.loop):
                if future.status == "error":
                    yield places[future.key], Failure(words_of(future.exception()))
                elif future.status == "finished":
                    yield places[future.key], future.result()
                else:
                    raise gone
                future.release()
        except (CancelledError, OSError):
            raise gone from None


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise SchedulerError(LACKING) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters is told here
    try:
        client = Client(address, timeout=WAIT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SchedulerError(f"no scheduler answers at {address}: {error}") from None
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
    except TimeoutError:
        client.close()
        raise SchedulerError(f"the scheduler at {address} has no worker") from None
    return client


def words_of(error: BaseException) -> str:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return f"each of {error.allowed_failures + 1} workers that had it was killed or lost"
    return "".join(traceback.format_exception(error)).strip()
