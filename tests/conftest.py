"""Test settings for all of them: hypothesis repeats the same cases on every machine.

The profile `nightly` (make nightly) tries others each time.
A test that needs a program which is not installed is skipped; where CI is set, it fails.
"""

import os
import tempfile
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

from tests.support.cases import USUAL
from tools.rig.planner.build import MissingToolError

settings.register_profile(
    "mapod",
    derandomize=True,
    deadline=None,
    max_examples=USUAL,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.register_profile(
    "nightly", parent=settings.get_profile("mapod"), derandomize=False, max_examples=1000
)
settings.register_profile(  # what fails need not be small
    "mutants",
    parent=settings.get_profile("mapod"),
    phases=(Phase.explicit, Phase.generate),
    max_examples=60,
)
settings.load_profile("mapod")


def skip_without_tools() -> Generator[None, object, object]:
    """Around a test: a tool that is missing skips it, and fails it on CI."""
    try:
        return (yield)
    except MissingToolError as missing:
        if os.environ.get("CI", "") not in ("", "0", "false"):
            raise
        pytest.skip(str(missing))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None, object, object]:
    return (yield from skip_without_tools())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call() -> Generator[None, object, object]:
    return (yield from skip_without_tools())


@pytest.fixture(scope="session", autouse=True)
def _own_temporary_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What tests, and the programs that they start, leave behind lies among pytest's folders."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(tmp_path_factory.getbasetemp()))
        patch.setattr(tempfile, "tempdir", None)
        yield


@pytest.fixture(scope="session")
def vectors() -> Path:
    return Path(__file__).parent / "vectors"
