"""The paper's method against a slow transcription of its steps, on random scenes."""

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from core.mapping.paper.steps import PaperSettings, ReferencePlane
from tests.support.cases import examples
from tests.support.maps.slow_reference_plane import SlowPlane

F64 = npt.NDArray[np.float64]
Step = tuple[float, float, float, float]  # changes of yaw, pitch, roll and travel before a scan
CLEAR = 1e-9  # a decision nearer to going the other way is rounding's, not the method's
SCENE = st.builds(
    PaperSettings,
    lens_height_m=st.floats(0.3, 1.5),
    tilt_rad=st.floats(math.radians(3), math.radians(30)),
    max_range_m=st.floats(5, 25),
    cells=st.integers(11, 61),
    cell_m=st.floats(0.1, 0.5),
    h_pos_m=st.floats(0.02, 0.3),
    h_neg_m=st.floats(-0.3, -0.02),
    epsilon_rad=st.floats(0.005, 0.3),
    eta_rad=st.floats(0.002, 0.05),
    compensated=st.just(True),
)
STEPS = st.lists(
    st.tuples(
        st.one_of(st.just(0.0), st.floats(-0.6, 0.6)),
        st.one_of(st.just(0.0), st.floats(-0.06, 0.06), st.floats(-0.004, 0.004)),
        st.one_of(st.just(0.0), st.floats(-0.06, 0.06)),
        st.one_of(st.just(0.0), st.floats(-2, 2), st.floats(0, 0.3)),
    ),
    min_size=1,
    max_size=8,
)


def random_ranges(plane: ReferencePlane, random: np.random.Generator) -> F64:
    """Mostly about where floor is expected, a few none, a few beyond the maximum."""
    near = random.uniform(0.1, 0.9) if random.random() < 0.4 else 1.0
    ranges_m = plane.reference_m * near * random.uniform(0.6, 1.2, plane.reference_m.size)
    ranges_m[random.random(ranges_m.size) < 0.1] = np.nan
    beyond = random.random(ranges_m.size) < 0.05
    ranges_m[beyond] = plane.settings.max_range_m * random.uniform(1, 2, beyond.sum())
    ranges_m[random.random(ranges_m.size) < 0.02] = 0.0
    return ranges_m


def check_same(plane: ReferencePlane, slow: SlowPlane) -> None:
    seen = {(int(row), int(column)) for row, column in np.argwhere(plane.grid.count > 0)}
    assert seen == set(slow.heights)
    assert seen == {(int(row), int(column)) for row, column in np.argwhere(plane.obstacles != 0)}
    assert np.isnan(plane.elevation_m).sum() == plane.elevation_m.size - len(seen)
    for at in seen:
        assert plane.grid.count[at] == len(slow.heights[at])
        assert plane.obstacles[at] == slow.states[at]
        assert plane.elevation_m[at] == pytest.approx(slow.average(at), abs=1e-9, rel=0)
    np.testing.assert_allclose(plane.reference_m, slow.reference, rtol=0, atol=1e-9)


def drive(scene: PaperSettings, sigma_rad: F64, steps: list[Step], seed: int) -> SlowPlane:
    """The same scans into both, compared after each one; stops where rounding would decide."""
    random = np.random.default_rng(seed)
    plane, slow = ReferencePlane(scene, sigma_rad), SlowPlane(scene, sigma_rad.tolist())
    yaw, pitch, roll, travel = random.uniform(-1, 1, 4)
    for step in steps:
        yaw, pitch, roll, travel = (
            was + change for was, change in zip((yaw, pitch, roll, travel), step, strict=True)
        )
        ranges_m = random_ranges(plane, random)
        plane.add(ranges_m, yaw, pitch, roll, travel)
        slow.scan(ranges_m.tolist(), yaw, -pitch, roll, travel)
        if slow.margin < CLEAR:
            break
        check_same(plane, slow)
    return slow


@settings(max_examples=examples(60), deadline=None)
@given(
    scene=SCENE,
    step_deg=st.floats(1.5, 5),
    first_deg=st.floats(30, 31),
    steps=STEPS,
    seed=st.integers(0, 10_000),
)
def test_the_maps_equal_a_slow_transcription_of_the_seven_steps(
    scene: PaperSettings, step_deg: float, first_deg: float, steps: list[Step], seed: int
) -> None:
    slow = drive(scene, np.radians(np.arange(first_deg, 150, step_deg)), steps, seed)
    assume(slow.margin > CLEAR)


def test_long_drives_equal_the_transcription_and_use_every_rule() -> None:
    scene = PaperSettings(
        lens_height_m=0.5,
        tilt_rad=math.radians(15),
        max_range_m=4.0,
        cells=51,
        cell_m=0.1,
        h_pos_m=0.05,
        h_neg_m=-0.05,
        epsilon_rad=0.04,
        eta_rad=0.01,
        compensated=True,
    )
    sigma_rad = np.radians(np.arange(30.0, 150.1, 2.0))
    events: set[str] = set()
    for seed in range(2):
        random = np.random.default_rng(100 + seed)
        sign = 1 if seed % 2 else -1
        changes = random.random((30, 4)) * (0.06, 1.0, 1.0, sign * 0.07)
        changes[:, 1:3] = random.normal(0.0, (0.007, 0.03), (30, 2))
        steps: list[Step] = [tuple(row) for row in changes.tolist()]
        slow = drive(scene, sigma_rad, steps, seed)
        assert slow.margin > CLEAR
        events |= slow.events
    assert events == {"turn", "scroll ahead", "scroll back", "restart", "nothing seen"}
