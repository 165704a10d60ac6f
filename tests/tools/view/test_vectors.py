"""Objects and path on their way to a page: bytes of the link in, messages of the socket out."""

import json
from typing import Any

import pytest

from mapod_link.frames import GEOM, MAP, OBJECTS, PATH, POSE, bytes_from_frame
from mapod_link.wires import UdpWire
from tests.support.link.object_frames import gone_record, object_record, objects_body, path_body
from tests.support.link.planner_sender import geom_body, map_body, pose_body
from tools.view.link_end import LinkEnd
from tools.view.vectors import MOST_OBJECTS, MOST_POINTS, VectorMessage, vectors_of

STALE_MS = 300


class Page:
    """A sender and what a page would get of it; time is given."""

    def __init__(self, end: LinkEnd) -> None:
        self.end, self.now_s, self._seq = end, 100.0, 0
        self.told: dict[str, VectorMessage] = {}
        self.begin()

    def begin(self, session: int = 1) -> None:
        self.say(GEOM, geom_body(session=session, stale_ms=STALE_MS))
        self.say(POSE, pose_body())
        self.say(MAP, map_body())

    def say(self, kind: int, body: bytes) -> None:
        self._seq += 1
        self.now_s += 0.001
        frame = bytes_from_frame(kind, self._seq, round(self.now_s * 1000), body)
        assert self.end.receiver.feed_datagram(self.now_s, frame)
        self.end.step()

    def news(self, later_s: float = 0.0) -> dict[str, Any]:
        """The messages that are new, by type."""
        before = self.told
        self.told = vectors_of(self.end, self.now_s + later_s, before)
        assert all(json.loads(new.text)["type"] == name for name, new in self.told.items())
        new = {name: told for name, told in self.told.items() if told is not before.get(name)}
        return {name: json.loads(told.text) for name, told in new.items()}


@pytest.fixture
def page() -> Any:
    end = LinkEnd(UdpWire("127.0.0.1", 0))
    yield Page(end)
    end.close()


def test_a_page_gets_each_change_once_and_an_empty_list_when_there_is_none_any_more(
    page: Page,
) -> None:
    assert page.news() == {}  # nobody tells of any
    still = object_record(3, 1)
    walker = object_record(258, 3, ((0, 0), (300, 0), (0, 300)), (2500, 0), velocity=(600, -250))
    page.say(OBJECTS, objects_body([still, walker], [still, walker]))
    told = page.news()["objects"]
    assert (told["state"], told["why"], told["left_out"]) == ("known", "", 0)
    assert told["objects"] == [
        {"id": 3, "kind": "static", "v": [0.0, 0.0], "bottom_m": 0.0, "top_m": 1.2,
         "confidence": 0.8, "outline": [0.5, -2.5, 1.5, -2.5, 1.5, -1.5, 0.5, -1.5]},
        {"id": 258, "kind": "moving", "v": [0.6, -0.25], "bottom_m": 0.0, "top_m": 1.2,
         "confidence": 0.8, "outline": [2.5, 0.0, 2.8, 0.0, 2.5, 0.3]},
    ]  # fmt: skip
    page.say(OBJECTS, objects_body([], [still, walker]))
    assert page.news() == {}
    page.say(OBJECTS, objects_body([gone_record(3)], [walker]))
    assert [one["id"] for one in page.news()["objects"]["objects"]] == [258]
    page.begin(session=2)
    gone = page.news()["objects"]
    assert (gone["state"], gone["objects"]) == ("none", [])
    page.say(OBJECTS, objects_body([walker], [walker]))
    assert [one["kind"] for one in page.news()["objects"]["objects"]] == ["moving"]


def test_what_is_stale_is_taken_back_and_what_is_in_doubt_is_said_to_be(page: Page) -> None:
    walker = object_record(258, 3, age_ms=300)
    held = [object_record(3, 9), walker]  # a kind of later days: it stands
    page.say(OBJECTS, objects_body(held, held))
    assert [one["kind"] for one in page.news()["objects"]["objects"]] == ["other", "moving"]
    assert [one["id"] for one in page.news(0.25)["objects"]["objects"]] == [3]
    late = page.news(0.36)["objects"]
    assert (late["objects"], late["state"], late["why"]) == (
        [],
        "suspect",
        "the robot is not heard",
    )
    page.begin()
    page.say(OBJECTS, objects_body([], held, look_ms=1001))
    blind = page.news()["objects"]
    assert (blind["objects"], blind["why"]) == ([], "nothing looks for objects")
    page.say(OBJECTS, objects_body([], held, waiting=3))
    doubtful = page.news()["objects"]
    assert (len(doubtful["objects"]), doubtful["state"]) == (2, "suspect")
    assert doubtful["why"] == "3 objects are still to be told"
    page.end.trouble = "the wire is gone: input/output error"
    assert page.news()["objects"]["objects"] == []


def test_of_the_path_a_page_gets_what_is_still_to_be_driven(page: Page) -> None:
    points = [(0, 0), (1000, 0), (1000, 500), (0, 500)]
    page.say(PATH, path_body(points, ahead=2, kind=0, left_out=5))
    told = page.news()["path"]
    assert (told["points"], told["kinds"]) == ([1.0, 0.0, 1.0, 0.5, 0.0, 0.5], [0, 0, 0])
    assert (told["state"], told["left_out"]) == ("known", 5)
    page.say(PATH, path_body(points[:2], number=2, total=4, ahead=0))  # the rest is not here yet
    told = page.news()["path"]
    assert (told["points"], told["state"]) == ([0.0, 0.0, 1.0, 0.0, *[None] * 4], "suspect")
    page.say(PATH, path_body(points[2:], number=2, total=4, first=2, ahead=0))
    assert page.news()["path"]["points"] == [0.0, 0.0, 1.0, 0.0, 1.0, 0.5, 0.0, 0.5]
    page.say(PATH, path_body(points, number=2, ahead=4))
    done = page.news()["path"]
    assert (done["points"], done["left_out"]) == ([], 0)
    page.say(PATH, path_body(points, number=3))
    assert page.news()["path"]["points"]
    assert page.news(0.31)["path"]["points"] == []  # the robot is not heard


def test_of_very_many_the_nearest_are_told_and_how_many_are_not(page: Page) -> None:
    far = [object_record(k, 1, place=(100_000 - 100 * k, 0)) for k in range(1, 301)]
    for k in range(0, 300, 5):
        page.say(OBJECTS, objects_body(far[k : k + 5], far))
    told = page.news()["objects"]
    assert told["left_out"] == 300 - MOST_OBJECTS
    assert {one["id"] for one in told["objects"]} == set(range(301 - MOST_OBJECTS, 301))
    total = MOST_POINTS + 100
    for k in range(0, total, 50):
        page.say(PATH, path_body([(k, 0)] * 50, total=total, first=k))
    told = page.news()["path"]
    assert (len(told["kinds"]), told["left_out"]) == (MOST_POINTS, 100)
