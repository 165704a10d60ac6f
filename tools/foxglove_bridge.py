"""A live bridge: what a planner link tells, as messages for Foxglove or Lichtblick.

A receiver of the link that serves a WebSocket, in a process of its own. The messages are those of a
recording, made by the same functions. What the link does not say any more is not shown: while it is
stale, or the map is not the sender's, every cell is unknown and there is no pose.
Needs foxglove-sdk, the extra `foxglove`.
"""

import argparse
import contextlib
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from foxglove import Channel, Context, Schema, start_server

from config_file import read_key
from core.config import ConfigError
from core.records import PoseReport, StopZoneReport
from mapod_link.bodies import MAP_VALID, POSE_VALID, ZONE_STALE_S, Pose, StopZone
from mapod_link.client import Link
from mapod_link.receiver import Receiver
from mapod_link.tiles import Tile
from mapod_link.wires import wire_from_url
from recording.foxglove import Messages, RobotShape, Topical, encoded, shape_of
from recording.schemas import SCHEMAS, TOPICS
from recording.states import CellWindow, StateRecord
from tools.cli.options import configured, fail
from tools.terminal.planner_end import WatchingReceiver
from tools.terminal.processes import Stop

OWN_CONFIG = Path("mapod.toml")
LOOPBACK = "127.0.0.1"
PERIOD_S = 0.1  # of pose, scene and health
MAP_PERIOD_S = 0.2
LAYERS_PERIOD_S = 2.0
WAIT_S = 0.02
LAYERS = ("height", "variance")
FAULT = 3  # mode
NO_POSE = PoseReport(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, math.inf, math.inf, math.inf, 0)


def pose_report(pose: Pose | None, is_stale: bool) -> PoseReport:
    """What the link told, without its validity where the link itself is stale."""
    if pose is None:
        return NO_POSE
    health = pose.health & ~(POSE_VALID | MAP_VALID) if is_stale else pose.health
    return PoseReport(
        pose.x_m,
        pose.y_m,
        pose.yaw_rad,
        pose.pitch_rad,
        pose.roll_rad,
        pose.v_mps,
        pose.w_radps,
        health,
        pose.age_scan_s,
        pose.age_ahrs_s,
        pose.age_enc_s,
        FAULT if is_stale else pose.mode,
    )


def zone_report(zone: StopZone | None, now_s: float) -> StopZoneReport | None:
    """None where there is none, or it is too old to say anything."""
    if zone is None or now_s - zone.arrived_s > ZONE_STALE_S:
        return None
    return StopZoneReport(
        zone.free_ahead_m,
        zone.obstacle_ahead_m,
        zone.free_behind_m,
        zone.obstacle_behind_m,
        zone.contact_s,
        zone.allowed_ahead_mps,
        zone.allowed_behind_mps,
        zone.nearest_m,
        zone.bearing_rad,
        (),
        zone.state,
        zone.causes,
    )


def maybe_window(receiver: Receiver, is_stale: bool) -> CellWindow | None:
    """The receiver's map; all of it unknown where it is not to be used."""
    if receiver.geom is None or receiver.origin is None:
        return None
    (i, j), cells = receiver.origin, receiver.window()
    if is_stale or receiver.needs.full:
        cells[:] = 0
    return CellWindow(cells, i, j, receiver.geom.cell_m)


class Layers:
    """Heights and variances of the window, asked for now and then."""

    def __init__(self) -> None:
        self._tiles: list[Tile] = []  # under way
        self._asked_s = -math.inf

    def step(self, receiver: Receiver, now_s: float) -> list[Tile]:
        """Those of one corner that have just become whole; none most of the time."""
        tiles = self._tiles
        if tiles and all(tile.done for tile in tiles):
            self._tiles = []
            is_whole = all(tile.complete and tile.place == tiles[0].place for tile in tiles)
            return tiles if is_whole else []
        geom = receiver.geom
        if not tiles and geom is not None and now_s - self._asked_s >= LAYERS_PERIOD_S:
            self._asked_s = now_s
            shape = geom.width, geom.height
            self._tiles = [receiver.ask_tile(name, 0, 0, *shape, in_window=True) for name in LAYERS]
        return []

    def drop(self, receiver: Receiver) -> None:
        """Nobody looks any more."""
        for tile in self._tiles:
            receiver.tiles.drop(tile)
        self._tiles = []


class Bridge:
    """What a receiver knows, as messages: the newest ones, as often as they are due.

    Args:
        tell: takes a message and its UTC in nanoseconds.
        is_wanted: whether anybody looks at a topic.
    """

    def __init__(
        self,
        receiver: Receiver,
        messages: Messages,
        tell: Callable[[Topical, int], None],
        is_wanted: Callable[[str], bool],
    ) -> None:
        self._receiver, self._messages = receiver, messages
        self._tell, self._is_wanted = tell, is_wanted
        self._layers = Layers()
        self._told_s = self._map_s = self._points_s = -math.inf
        self._advice = ("", "")

    def step(self, now_s: float) -> None:
        if now_s - self._told_s < PERIOD_S:
            return
        self._told_s = now_s
        receiver = self._receiver
        is_stale = receiver.stale(now_s)
        window = None
        if now_s - self._map_s >= MAP_PERIOD_S and self._is_wanted("/map"):
            self._map_s, window = now_s, maybe_window(receiver, is_stale)
        pose, zone = pose_report(receiver.pose, is_stale), zone_report(receiver.stop_zone, now_s)
        for message in self._messages.of_state(StateRecord(now_s, pose, zone, window)):
            self._tell(message, self._messages.t_ns(now_s))
        self._tell_advice(now_s)
        self._tell_layers(now_s)
        if self._is_wanted("/points") and not is_stale:
            self._tell_points()

    def _tell_points(self) -> None:
        """The newest sweep, once, and ask for the next one."""
        sweep = self._receiver.scan
        if sweep is not None and sweep.arrived_s != self._points_s:
            self._points_s = sweep.arrived_s
            message = self._messages.of_points(sweep.arrived_s, sweep.points_m.astype(np.float32))
            self._tell(message, self._messages.t_ns(sweep.arrived_s))
        self._receiver.ask_scan()

    def _tell_advice(self, now_s: float) -> None:
        """A line of the log for each change of what a planner would do."""
        advice = self._receiver.advice(now_s)
        if advice != self._advice:
            self._advice = advice
            word, why = advice
            level = "info" if word == "go" else "warning"
            line = self._messages.of_log(now_s, level, f"{word}: {why}" if why else word)
            self._tell(line, self._messages.t_ns(now_s))

    def _tell_layers(self, now_s: float) -> None:
        receiver = self._receiver
        if not self._is_wanted("/elevation"):
            self._layers.drop(receiver)
            return
        tiles = self._layers.step(receiver, now_s)
        if tiles and tiles[0].place is not None and receiver.origin is not None:
            height, variance = tiles
            i, j = (near(at, to) for at, to in zip(tiles[0].place, receiver.origin, strict=True))
            window = CellWindow(receiver.window(), i, j, height.cell_m)
            heights = self._messages.of_heights(now_s, window, height.values, variance.values)
            self._tell(heights, self._messages.t_ns(now_s))


def near(at: int, to: int) -> int:
    """A cell that is told modulo 65 536, as the one nearest to another."""
    return to + (at - to + 2**15) % 2**16 - 2**15


class Channels:
    """The topics of one WebSocket server."""

    def __init__(self, port: int) -> None:
        """Of this machine alone; 0: any port. Raises OSError: the port is taken."""
        self._context = context = Context()  # which ends with whoever holds it
        schemas = {
            name: Schema(name=name, encoding="jsonschema", data=text.encode())
            for name, text in SCHEMAS.items()
        }
        self._channels = {
            topic: Channel(topic, schema=schemas[name], message_encoding="json", context=context)
            for topic, name in TOPICS.items()
        }
        try:
            self._server = start_server(name="mapod", host=LOOPBACK, port=port, context=context)
        except RuntimeError as error:
            raise OSError(str(error)) from None
        self.url = f"ws://{LOOPBACK}:{self._server.port}"

    def is_wanted(self, topic: str) -> bool:
        return self._channels[topic].has_sinks()

    def tell(self, message: Topical, t_ns: int) -> None:
        topic, _, content = message
        if self.is_wanted(topic):
            self._channels[topic].log(encoded(content), log_time=t_ns)

    def close(self) -> None:
        self._server.stop()


def serve_foxglove(options: argparse.Namespace) -> int:
    """`mapod view --foxglove`. Exit status: 0 ended as told, 1 a port is gone, 2 wrong use."""
    try:
        wanted = options.config or (OWN_CONFIG if OWN_CONFIG.exists() else None)
        shape = shape_of(configured(wanted)) if wanted else None
        key = read_key(options.key_file)
        wire = wire_from_url(options.port)
    except (ConfigError, ValueError) as error:
        return fail("view", error)
    except OSError as error:
        return fail("view", f"{options.port}: {error.strerror or error}", 1)
    with contextlib.closing(wire), Stop().on_signals() as stop:
        try:
            channels = Channels(options.foxglove_port)
        except OSError as error:
            return fail("view", f"--foxglove-port {options.foxglove_port}: {error}", 1)
        link = Link(wire, WatchingReceiver(key))
        until_s = link.now_s() + (options.seconds or math.inf)
        try:
            serve(link, shape, channels, lambda now_s: stop.wanted or now_s >= until_s)
        except OSError as error:
            return fail("view", f"{options.port}: {error.strerror or error}", 1)
    return 0


def serve(
    link: Link, shape: RobotShape | None, channels: Channels, is_over: Callable[[float], bool]
) -> None:
    """Bridge a link until it is over. Raises OSError: the wire is gone."""
    print(f"Foxglove, Lichtblick: open a connection to {channels.url}", flush=True)
    print(f"watching {link.url}; Ctrl-C ends", flush=True)
    messages = Messages(shape, time.time() - time.monotonic())
    bridge = Bridge(link.receiver, messages, channels.tell, channels.is_wanted)
    try:
        while not is_over(now_s := link.step(WAIT_S)):
            bridge.step(now_s)
    finally:
        channels.close()
