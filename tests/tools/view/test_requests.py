"""What a page says: taken where it fits, and answered with one line where it does not."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from tools.view.requests import AskCell, AskHistory, Auth, Drive, ShowLayers, Stop, request_of

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=6,
)
TYPES = ("auth", "layers", "cell", "drive", "stop", "history", "flight")
NAMES = ("token", "names", "i", "j", "v", "w", "dead_man", "t_s")
NEAR = st.fixed_dictionaries({"type": st.sampled_from(TYPES)}, optional=dict.fromkeys(NAMES, JSON))


def test_each_message_is_what_the_page_says() -> None:
    said: dict[str, Any] = {
        '{"type":"auth","token":"x"}': Auth("x"),
        '{"type":"layers","names":["height","slope"]}': ShowLayers(["height", "slope"]),
        '{"type":"cell","i":-3,"j":70000}': AskCell(-3, 70000),
        '{"type":"drive","v":1,"w":-0.5,"dead_man":true,"t_s":7.5}': Drive(1, -0.5, True, 7.5),
        '{"type":"stop"}': Stop(),
        '{"type":"history","t_s":180}': AskHistory(180),
    }
    assert [request_of(text) for text in said] == list(said.values())


@given(st.text(max_size=200) | (JSON | NEAR).map(json.dumps))
def test_nothing_that_is_said_raises_and_no_drive_is_beyond_its_range(text: str) -> None:
    request = request_of(text)
    if isinstance(request, str):
        assert request.startswith("not understood: ")
        assert "\n" not in request
    if isinstance(request, Drive):
        assert -1 <= request.v <= 1
        assert -1 <= request.w <= 1


def test_what_no_hand_can_mean_is_refused() -> None:
    good = {"type": "drive", "v": 0.5, "w": 0.5, "dead_man": True, "t_s": 1.0}
    assert isinstance(request_of(json.dumps(good)), Drive)
    for change in ({"v": 1.01}, {"w": -2}, {"v": "1"}, {"v": None}, {"dead_man": 1}, {"t_s": None}):
        assert isinstance(request_of(json.dumps(good | change)), str), change
    for text in (json.dumps(good).replace("0.5", "1e999"), json.dumps(good).replace("0.5", "NaN")):
        assert isinstance(request_of(text), str), text
    assert isinstance(request_of("[" * 3000), str)
    assert isinstance(request_of('{"type":"cell","i":1e300,"j":0}'), str)
    assert isinstance(request_of('"\ud800"'), str)
