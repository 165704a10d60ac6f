"""Which settings a sweep tries, from the words of the command line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tools.sweep.space import SpaceError, sections_of, settings_of

LISTS = "map.cell_m=0.1,0.2", "map.method=surface,reference_plane"


def test_each_value_is_tried_with_each_other() -> None:
    assert settings_of(LISTS, None, 1) == [
        {"map.cell_m": cell_m, "map.method": method}
        for cell_m in (0.1, 0.2)
        for method in ("surface", "reference_plane")
    ]
    assert settings_of([], None, 1) == [{}], "as recorded"
    assert sections_of({"map.cell_m": 0.1, "map.cells": 9, "log.level": "info"}) == {
        "map": {"cell_m": 0.1, "cells": 9},
        "log": {"level": "info"},
    }


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("obstacle.h_pos_m=0.08:0.12:3", [0.08, 0.1, 0.12]),
        ("obstacle.h_neg_m=-0.2:-0.1:2", [-0.2, -0.1]),
        ("map.cells=101:201:3", [101, 151, 201]),
        ("robot.unknown_stops=true,false", [True, False]),
        ("map.cell_m=0.2,0.20,0.1", [0.2, 0.1]),
        ('planner.port="udp://127.0.0.1:9750"', ["udp://127.0.0.1:9750"]),
        ("drive.invert=[],[1,2]", [[], [1, 2]]),
    ],
)
def test_values_are_those_of_the_settings_file(text: str, values: list[object]) -> None:
    key = text.partition("=")[0]
    found = [settings[key] for settings in settings_of([text], None, 1)]
    assert found == values
    assert [type(value) for value in found] == [type(value) for value in values]


@given(seed=st.integers(0, 1000), count=st.integers(1, 30))
def test_samples_lie_in_their_spans_and_a_seed_repeats_them(seed: int, count: int) -> None:
    texts = ["obstacle.h_pos_m=0.08:0.12", "map.cell_m=0.1,0.2"]
    drawn = settings_of(texts, count, seed)
    assert drawn == settings_of(texts, count, seed)
    assert 1 <= len(drawn) <= count
    assert all(0.08 <= one["obstacle.h_pos_m"] <= 0.12 for one in drawn)
    assert all(one["map.cell_m"] in (0.1, 0.2) for one in drawn)


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["cell_m=0.1"], "must be section.key=value"),
        (["map.cell_m"], "must be section.key=value"),
        (["map.cell_m="], "must be section.key=value"),
        (["map.cell_m=0.2:0.1:3"], "to a greater one"),
        (["map.cell_m=0.1:0.2:1"], "must have 2 to 1000 values, has 1"),
        (["map.cell_m=0.1:0.2"], "say how many values"),
        (["map.cell_m=0.1", "map.cell_m=0.2"], "is given twice"),
        (["a.b=0:1:1000", "a.c=0:1:1000"], "1000000 settings are more than 10000"),
    ],
)
def test_what_cannot_be_tried_is_told(texts: list[str], words: str) -> None:
    with pytest.raises(SpaceError, match=words):
        settings_of(texts, None, 1)
