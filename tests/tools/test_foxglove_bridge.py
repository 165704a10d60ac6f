"""The bridge from a planner link to Foxglove: what it shows, and to a real WebSocket client."""

import asyncio
import base64
import json
import socket
import struct
import subprocess
import sys
import time
from typing import Any, cast

import numpy as np
import pytest

from mapod_link.bodies import FREE, OBSTACLE
from mapod_link.frames import GEOM, MAP, POSE, STOP_ZONE, bytes_from_frame
from mapod_link.receiver import Receiver
from recording.foxglove import Message, Messages, RobotShape, Topical
from tests import ROOT
from tests.support.link.planner_sender import (
    NONCE,
    Line,
    geom_body,
    map_body,
    op,
    pose_body,
    receiving,
    zone_body,
)
from tools.rig.runs.loop import Loop

pytest.importorskip("foxglove")
aiohttp = pytest.importorskip("aiohttp")
SHAPE = RobotShape(0.5, 0.2, 0.6, (0.25, 0.0, 1.08), (0.0, 0.13, 0.0))
CELLS = op(FREE, 3) + op(OBSTACLE, 2) + op(FREE, 4)


class Told:
    """Takes the messages of a bridge, and is all ears for every topic."""

    def __init__(self) -> None:
        self.messages: dict[str, Message] = {}

    def take(self, message: Topical, t_ns: int) -> None:
        topic, _, content = message
        self.messages[topic] = content


def bridged(line: Line[Receiver]) -> tuple[Any, Told]:
    from tools.foxglove_bridge import Bridge

    told = Told()
    messages = Messages(SHAPE, 0.0)
    return Bridge(line.planner, messages, told.take, lambda topic: True), told


def states_of(grid: Message) -> Any:
    data = np.frombuffer(base64.b64decode(grid["data"]), np.uint8)
    return data.reshape(-1, grid["column_count"], grid["cell_stride"])[..., 0]


def test_the_map_of_the_link_is_the_map_that_is_shown() -> None:
    line = receiving()
    line.send(MAP, map_body(CELLS, start=9))
    line.send(STOP_ZONE, zone_body())
    bridge, told = bridged(line)
    bridge.step(line.now_s)
    assert (states_of(told.messages["/map"]) == line.planner.cells).all()
    assert (line.planner.cells[1] == [1, 1, 1, 2, 2, 1, 1, 1, 1]).all()
    assert told.messages["/health"]["free_ahead_m"] == 1.25
    assert told.messages["/log"]["message"] == "go"


def test_of_a_stale_link_nothing_is_shown_but_that() -> None:
    line = receiving()
    line.send(MAP, map_body(CELLS, start=9))
    bridge, told = bridged(line)
    bridge.step(line.now_s)
    assert {"/pose", "/tf"} <= told.messages.keys()
    told.messages.clear()
    bridge.step(line.now_s + 1.0)
    assert not states_of(told.messages["/map"]).any()
    assert not {"/pose", "/tf"} & told.messages.keys()
    assert told.messages["/health"]["map_valid"] == 0
    assert "free_ahead_m" not in told.messages["/health"]
    assert told.messages["/log"]["message"] == "stop: link stale"


def test_points_and_heights_of_a_robot_come_over_its_link() -> None:
    loop = Loop("corridor", 1, planner=Receiver(NONCE), drives=True)
    line = Line(cast(Receiver, loop.link_end))
    bridge, told = bridged(line)
    loop.run(4.0, each=lambda: bridge.step(loop.now_s))
    points = packed_of(told.messages["/points"])
    assert len(points) > 100
    assert all(0.3 < np.hypot(x, y) < 30.0 for x, y, _ in points)
    heights = packed_of(told.messages["/elevation"])
    height_m, variance_m2 = heights["height"], heights["variance"]
    assert np.isfinite(height_m).sum() > 50
    assert np.nanmin(variance_m2) >= 0.0
    layer = loop.app.mapper.maybe_layer("height")
    assert layer is not None
    known = np.isfinite(height_m)
    assert np.nanmax(layer.values) == pytest.approx(height_m[known].max(), abs=0.3)


def packed_of(message: Message) -> Any:
    """The elements of a message's data, by their fields."""
    kinds = {1: "u1", 7: "<f4"}
    dtype = np.dtype([(one["name"], kinds[one["type"]]) for one in message["fields"]])
    assert dtype.itemsize == message.get("cell_stride", message.get("point_stride"))
    return np.frombuffer(base64.b64decode(message["data"]), dtype)


async def first_message(url: str, topic: str) -> tuple[dict[str, Any], dict[str, Any], int]:
    """The channel, one message and its time, as a client of Foxglove's protocol gets them."""
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=["foxglove.sdk.v1"], max_msg_size=0) as ws,
    ):
        channel: dict[str, Any] = {}
        while True:
            got = await ws.receive(timeout=30)
            if got.type == aiohttp.WSMsgType.TEXT:
                said = json.loads(got.data)
                found = [one for one in said.get("channels", []) if one["topic"] == topic]
                if said["op"] == "advertise" and found:
                    [channel] = found
                    subscription = {"id": 7, "channelId": channel["id"]}
                    ask = {"op": "subscribe", "subscriptions": [subscription]}
                    await ws.send_str(json.dumps(ask))
            elif got.type == aiohttp.WSMsgType.BINARY and got.data[0] == 1:
                subscription_id, t_ns = struct.unpack_from("<IQ", got.data, 1)
                assert subscription_id == 7
                return channel, json.loads(got.data[13:]), t_ns
            else:
                assert got.type == aiohttp.WSMsgType.BINARY, got


def send_frames(to: socket.socket, address: tuple[str, int], seq: int) -> None:
    bodies = [(GEOM, geom_body()), (POSE, pose_body()), (MAP, map_body(CELLS, start=9))]
    for k, (kind, body) in enumerate(bodies):
        t_ms = round(time.monotonic() * 1000) % 2**32
        to.sendto(bytes_from_frame(kind, seq + k, t_ms, body), address)


async def watched(url: str, address: tuple[str, int], topic: str) -> Any:
    """A message of the topic, while frames are sent to the bridge."""
    asked = asyncio.ensure_future(first_message(url, topic))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        seq = 1
        while not asked.done():
            send_frames(sender, address, seq)
            seq += 3
            await asyncio.wait([asked], timeout=0.02)
    return asked.result()


@pytest.mark.real_time
def test_a_client_sees_the_channels_and_gets_a_grid() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        address = free.getsockname()
    command = [sys.executable, "-m", "mapod", "view", "--port", f"udp://127.0.0.1:{address[1]}"]
    command += ["--foxglove", "--foxglove-port", "0"]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            url = next(line for line in process.stdout if "ws://" in line).split()[-1]
            channel, grid, t_ns = asyncio.run(watched(url, address, "/map"))
        finally:
            process.terminate()
    assert (channel["schemaName"], channel["encoding"]) == ("foxglove.Grid", "json")
    assert json.loads(channel["schema"])["title"] == "foxglove.Grid"
    assert states_of(grid)[1].tolist() == [1, 1, 1, 2, 2, 1, 1, 1, 1]
    assert grid["timestamp"] == {"sec": t_ns // 10**9, "nsec": t_ns % 10**9}
    assert process.returncode == 0
