"""The floors of real robots: nearly all is swept, in little more than the ideal length."""

from pathlib import Path

import pytest

from core.paths.coverage.measures import measures
from core.paths.coverage.plan import plan_coverage
from tests import VECTORS
from tests.support.cases import few
from tools.floorplans.plan_file import load_plan
from tools.floorplans.table import MOTION, VACUUM

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "path", few(sorted((VECTORS / "floorplans").glob("*.json")), 2), ids=lambda p: p.stem
)
def test_99_percent_are_swept_at_a_ratio_of_at_most_1_3(path: Path) -> None:
    plan = load_plan(path)
    told = measures(plan_coverage(plan.free, VACUUM), plan.free, VACUUM, MOTION)
    assert told.covered_of_reachable > 0.99
    assert told.length_ratio < 1.3
    assert told.outside_m2 < 1e-9
