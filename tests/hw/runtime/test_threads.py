"""Threads beside the loop: they work where the system permits neither rights nor cores."""

import os
from typing import Any

import pytest

from hw.runtime.threads import LogWriter, Worker, take_real_time
from tests import Patch


def refuse(*_: Any) -> None:
    raise PermissionError(1, "Operation not permitted")


@pytest.fixture(params=[refuse, lambda *_: None], ids=["no rights", "rights, but no cores"])
def granted(request: pytest.FixtureRequest, monkeypatch: Patch) -> bool:
    """A filter of system calls as of a service or a container; whether it lets us go first."""
    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    monkeypatch.setattr(os, "sched_setscheduler", request.param)
    return request.param is not refuse


@pytest.mark.usefixtures("granted")
def test_what_opens_serial_lines_works() -> None:
    worker = Worker()
    assert worker.submit(lambda: 7).result(timeout=10) == 7
    worker.finish()


@pytest.mark.usefixtures("granted")
def test_the_log_is_written() -> None:
    read, write = os.pipe()
    log = LogWriter(write)
    log.write("it runs\n")
    log.close()
    os.close(write)
    with os.fdopen(read) as text:
        assert text.read() == "it runs\n"


def test_the_loop_begins(granted: bool, monkeypatch: Patch) -> None:
    monkeypatch.setattr("hw.runtime.threads.lock_memory", lambda: False)
    for name in ("freeze", "disable"):
        monkeypatch.setattr(f"gc.{name}", lambda: None)
    assert take_real_time() == (False, granted)
