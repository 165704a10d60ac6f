"""The soak's short form: both receivers and the sender on rough wires, every kind of link."""

import pytest

from tools.conformance.exam import DeviationError
from tools.conformance.soak import Soak, leg_of
from tools.conformance.wire import FREE

FRAMES = 1300  # in each of 16 legs
SLOW_LEGS = sorted(set(range(16)) - {0, 7})  # those two have what the others have, by halves


@pytest.mark.parametrize(
    "number", [0, 7, *(pytest.param(number, marks=pytest.mark.slow) for number in SLOW_LEGS)]
)
def test_both_receivers_agree_and_nothing_is_free_that_was_told_otherwise(number: int) -> None:
    leg = Soak(leg_of(number, seed=3), seed=3)
    leg.run(FRAMES)
    sums = leg.sums()
    assert sums["wraps of seq"] >= 1 or sums["sender restart"] >= 1
    assert sums["settled"] >= 1
    assert sums["lost"] > 0
    assert sums["compared"] > 50


def test_all_kinds_of_links_are_among_the_legs() -> None:
    legs = [leg_of(number, seed=1) for number in range(16)]
    kinds = {(leg.datagrams, leg.keyed, leg.way_back) for leg in legs}
    assert len(kinds) == 8
    answering = {(leg.datagrams, leg.keyed, leg.c_answers) for leg in legs if leg.way_back}
    assert len(answering) == 8


def test_the_same_leg_and_seed_bring_the_same_about() -> None:
    legs = [Soak(leg_of(5, seed=9), seed=9) for _ in range(2)]
    for leg in legs:
        leg.run(400)
    assert legs[0].sums() == legs[1].sums()
    assert list(legs[0].tail) == list(legs[1].tail)


def test_a_cell_that_is_free_in_one_receiver_alone_is_found() -> None:
    leg = Soak(leg_of(2, seed=1), seed=1)
    leg.run(300)
    cells = leg.python._map._cells
    cells[cells != FREE] = FREE
    with pytest.raises(DeviationError, match="cells"):
        leg.run(600)
