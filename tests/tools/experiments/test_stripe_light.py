"""In whatever light, the camera's driver measures the line or says that there is none."""

import pytest

from hw.stripe.detect import Method
from tools.experiments.stripe_light import BEGIN, END, LIGHTS, Columns, Looker
from tools.experiments.terrain.report import DOCUMENT

pytest.importorskip("cv2", reason="needs OpenCV: pip install 'mapod[camera]'")
SEEDS = range(6)


def seen(light: str, find: Method = "peak") -> Columns:
    looker = Looker(find)
    return sum((looker.look(seed, **LIGHTS[light]) for seed in SEEDS), Columns())


@pytest.mark.parametrize("light", ["dark", "lamp", "lamp, automatic exposure"])
def test_indoors_nearly_all_columns_are_right(light: str) -> None:
    columns = seen(light)
    assert columns.right > 0.95 * columns.all
    assert columns.wrong < 0.003 * columns.all
    assert columns.doubted == 0


def test_by_a_window_its_pools_of_light_cost_columns_and_make_none_wrong() -> None:
    columns = seen("window")
    assert 0.3 * columns.all < columns.right < 0.95 * columns.all
    assert columns.wrong < 0.003 * columns.all


@pytest.mark.parametrize("light", [name for name in LIGHTS if "sun" in name or "off" in name])
def test_in_the_sun_or_without_the_laser_no_line_is_invented_and_all_is_in_doubt(
    light: str,
) -> None:
    columns = seen(light)
    assert (columns.right, columns.wrong) == (0, 0)
    assert columns.doubted == columns.images == len(SEEDS)


def test_where_the_line_is_weak_the_papers_way_sees_less_of_it_and_in_the_sun_nothing() -> None:
    ours, papers = (seen("dark", find) for find in ("peak", "threshold"))
    assert ours.right - papers.right > 0.2 * ours.all
    assert papers.wrong < 0.003 * papers.all
    sun = seen("sun", "threshold")
    assert (sun.right, sun.wrong, sun.doubted) == (0, 0, sun.images)


def test_the_document_has_the_place_of_the_tables() -> None:
    told = DOCUMENT.read_text(encoding="utf-8")
    assert told.count(BEGIN) == told.count(END) == 1
    for light in LIGHTS:
        assert f"| {light} | threshold |" in told
        assert f"| {light} | peak |" in told
