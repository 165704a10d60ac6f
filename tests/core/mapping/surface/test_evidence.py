"""What one return says of the cell where it lies."""

from core.mapping.surface.evidence import lower
from core.mapping.surface.sweep import FLOOR
from tests.support.maps.ground_cells import GroundCells, met


def test_floor_seen_lower_by_another_attitude_makes_no_face_of_it_later() -> None:
    """From afar it was laid 6 cm too high: when it is met anew the ground goes down, all of it."""
    ground = GroundCells()
    at = ground.lay(2, 0, 0.06, var_m2=1e-3, floor_s=0.0, looks=1, floor_parts=1)
    assert met(ground, 20.0, 0.41, 0.0)["kind"][0] == FLOOR
    for k, x_m in enumerate((0.46, 0.51, 0.56)):
        assert met(ground, 20.0 + 0.04 * k, x_m, 0.03)["kind"][0] == FLOOR
    assert bin(ground.cells["parts"][at]).count("1") == 5


def test_floor_in_a_part_has_the_cells_beside_it_decided_again_that_lack_some() -> None:
    ground = GroundCells()
    for i, parts in ((1, 0x1), (2, 0x0), (3, 0xFFFF)):
        ground.lay(i, 0, 0.0, floor_parts=parts)
    for lacking in ({ground.at(1, 0)}, set()):  # the second time, the part was known
        met(ground, 20.0, 0.46, 0.0)
        touched = ground.touched.at[: ground.touched.used[0]].tolist()
        assert set(touched) == {ground.at(2, 0)} | lacking


def test_where_a_beam_was_under_the_ground_all_cells_around_are_decided_again() -> None:
    ground = GroundCells()
    at = ground.lay(2, 0, 0.0, floor_parts=0x00FF)
    for depth_m, around in ((-0.2, 9), (-0.3, 9), (-0.1, 1)):
        ground.touched.used[0] = 0
        lower(at, 0x1000, depth_m, ground.surface)
        assert ground.touched.used[0] == around
