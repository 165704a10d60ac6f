"""A recorded drive as others' programs read it: with mcap's own reader and Foxglove's documents."""

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from core.records import F64, FREE, OBSTACLE
from recording.reader import Recording
from recording.schemas import SCHEMAS, TOPICS
from tests.recording.test_foxglove import cell_at, lacks
from tests.support.robot.recorded import RecordedLoop
from tests.support.robot.shipped import shipped
from tools.export.collect import collect_points, trusted_layer
from tools.replay.player import Player

STATES = {FREE: 1, OBSTACLE: 2}
Told = dict[str, list[tuple[int, dict[str, Any]]]]  # by topic: time in ns, and message


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of a drive."""
    path = tmp_path_factory.mktemp("others") / "drive.mcap"
    loop = RecordedLoop(path, shipped())
    loop.run(6.0)
    loop.recorder.close()
    return path


@pytest.fixture(scope="module")
def told(path: Path) -> Told:
    found: Told = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                assert schema is not None
                assert (schema.name, schema.encoding) == (TOPICS[channel.topic], "jsonschema")
                assert schema.data.decode() == SCHEMAS[schema.name]
                content = json.loads(message.data)
                found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def test_the_file_is_whole_and_indexed(path: Path) -> None:
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.channel_count == len(summary.channels)
    assert {chunk.compression for chunk in summary.chunk_indexes} == {"zstd"}


def test_every_message_is_what_its_schema_says(told: Told) -> None:
    expected = {"/map", "/elevation", "/scan", "/points", "/tf", "/pose", "/scene", "/health"}
    assert expected <= told.keys() <= TOPICS.keys()
    for topic, messages in told.items():
        schema = json.loads(SCHEMAS[TOPICS[topic]])
        for _, message in messages:
            message = {
                name: one for name, one in message.items() if (topic, name) != ("/log", "of")
            }
            assert list(lacks(message, schema, topic)) == []


def test_the_maps_are_those_of_the_run(path: Path, told: Told) -> None:
    """Each one against the replay at that instant, cell by cell."""
    recording = Recording(path)
    player = Player(recording)
    obstacles = 0
    for t_ns, grid in told["/map"]:
        player.play_until(t_ns * 1e-9 - recording.utc_offset_s + 1e-6)
        view = trusted_layer(player, "state")
        assert view is not None
        for row, column in np.ndindex(view.values.shape):
            place = [(corner + at + 0.5) * view.cell_m
                     for corner, at in ((view.corner_i, column), (view.corner_j, row))]  # fmt: skip
            value = view.values[row, column]
            wanted = 0 if math.isnan(value) else STATES[int(value)]
            if row % 7 == column % 5 == 0 or wanted == 2:  # a fair sample of so many
                assert cell_at(grid, "state", *place) == wanted
                obstacles += wanted == 2
    assert obstacles > 100


def test_the_pose_is_that_of_the_run(path: Path, told: Told) -> None:
    recording = Recording(path)
    player = Player(recording)
    for t_ns, message in told["/pose"]:
        player.play_until(t_ns * 1e-9 - recording.utc_offset_s + 1e-6)
        pose = player.app.mapper.maybe_pose(player.now_s)
        assert pose is not None
        position = message["pose"]["position"]
        assert (position["x"], position["y"]) == pytest.approx((pose.x_m, pose.y_m), abs=1e-9)
    assert len(told["/pose"]) > 5


def test_the_points_are_those_that_were_mapped(path: Path, told: Told) -> None:
    sweeps: list[F64] = []
    player = Player(Recording(path))
    collect_points(player, player.steps_until(math.inf), lambda t_s, places: sweeps.append(places))
    for _, message in told["/points"]:
        points = np.frombuffer(base64.b64decode(message["data"]), "<f4").reshape(-1, 3)
        offs_m = [np.abs(one - points).max() for one in sweeps if len(one) == len(points)]
        assert min(offs_m) < 0.01
    assert len(told["/points"]) >= len(told["/scan"]) - 2  # none before the map is trusted
