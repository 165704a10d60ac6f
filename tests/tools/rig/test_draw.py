"""Pictures of scenes from above: what is where, in which colour."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fakes.scenes.scene import Scene, Solid
from fakes.scenes.solids import BLACK, GLASS, Pillar
from fakes.world.crowd import Walker
from fakes.world.error_models import Patch
from fakes.world.magnetic import MagneticDisturbance
from tests import Capsys
from tools.rig.draw import main
from tools.rig.runs.picture import BLACK as BLACK_COLOUR
from tools.rig.runs.picture import GLASS as GLASS_COLOUR
from tools.rig.runs.picture import LOWER, Chart, chart_of

SCENE = Scene(
    "some",
    (
        Solid("floor", (-12.0, 20.0), (-12.0, 12.0), (-1.0, 0.0)),
        Solid("yard", (20.0, 26.0), (-12.0, 12.0), (-2.0, -1.2)),
        Solid("box", (12.0, 14.0), (3.0, 5.0), (0.0, 1.0)),
        Solid("roof", (15.0, 17.0), (-5.0, -3.0), (2.0, 2.2)),
        Solid("pane", (10.0, 12.0), (-8.0, -7.8), (0.0, 2.0), material=GLASS),
        Solid("mat", (16.0, 18.0), (6.0, 8.0), (0.0, 0.004), material=BLACK),
        Pillar("post", (16.0, 0.0), 0.5, (0.0, 2.5)),
    ),
    goals=((14.0, -1.0),),
    steels=(MagneticDisturbance("door", (10.0, 8.0), 0.3),),
    patches=(Patch("wet", (10.0, 11.0), (0.0, 1.0), 0.3),),
    walkers=(Walker("who", ((12.0, -10.0), (18.0, -10.0))),),
)


def colour(chart: Chart, x: float, y: float) -> tuple[int, ...]:
    column, row = chart.xy(x, y)
    return tuple(int(part) for part in np.array(chart.image)[int(row), int(column)])


def test_places_have_the_colours_of_what_is_there_and_high_y_is_up() -> None:
    chart = chart_of(SCENE)
    assert colour(chart, 18.5, -4.0) == (245, 245, 245)
    assert colour(chart, 16.0, -4.0) == (245, 245, 245)  # under the roof
    assert colour(chart, 23.0, 0.0) == LOWER
    assert colour(chart, 11.0, -7.9) == GLASS_COLOUR
    assert colour(chart, 17.0, 7.0) == BLACK_COLOUR
    assert colour(chart, 13.0, 4.0) == (135, 135, 135)
    assert colour(chart, 16.3, 0.3)[0] < 60
    assert colour(chart, 14.0, -1.0)[0] > colour(chart, 14.0, -1.0)[1]  # a goal is red
    assert colour(chart, 15.0, -10.0)[1] > colour(chart, 15.0, -10.0)[0]  # a way is green
    chart = chart_of(SCENE, 10.0)
    (x0, y0), (x1, y1) = chart.xy(0.0, 0.0), chart.xy(1.0, 1.0)
    assert (x1 - x0, y1 - y0) == pytest.approx((10.0, -10.0))
    assert chart.image.size == (400, 260)


def test_the_command_writes_a_picture(tmp_path: Path, capsys: Capsys) -> None:
    assert main([str(tmp_path)]) == 1  # no recorded run
    assert capsys.readouterr().err.count("\n") == 1
    out = tmp_path / "scene.png"
    assert main(["dock", "--seed", "3", "--out", str(out)]) == 0
    with Image.open(out) as picture:
        assert picture.size[0] > 500
    said = capsys.readouterr().out
    assert "dock, seed 3: a loading dock" in said
    assert "solids" in said
    assert "problem" not in said
