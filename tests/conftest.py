"""Test settings for the whole house: hypothesis repeats the same cases on every machine."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "mapod",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile("mapod")


@pytest.fixture(scope="session")
def vectors() -> Path:
    """Where bytes from manuals and recordings lie."""
    return Path(__file__).parent / "vectors"
