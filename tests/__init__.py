"""Tests, by the rooms of the code: tests/core, tests/hw, tests/fakes, tests/tools, tests/app."""

from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
VECTORS = ROOT / "tests" / "vectors"
Capsys = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch
