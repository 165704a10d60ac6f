"""The C header reads and writes the frames that the protocol prints, byte for byte."""

import pytest

from mapod_link.frames import frame_from_bytes, signed_bytes_from_frame
from tests.support.link.c_link import NOT_KNOWN, Ask, CReceiver, ExternalPose, serial_from_frame
from tests.support.link.planner_sender import VECTORS, vector

KEY, NONCE = bytes.fromhex(VECTORS["auth_key"]), int(VECTORS["auth_nonce"], 0)
RECTANGLE = (236, -40, 5, 3)  # i, j, width, height


def begun() -> CReceiver:
    """A receiver that has heard the geometry, the pose and the map of the worked example."""
    receiver = CReceiver(NONCE, max_cells=101 * 101)
    for name in ("geom", "pose", "map"):
        assert receiver.feed_datagram(1.02, vector(name))
    return receiver


def keyed() -> CReceiver:
    """A receiver with the key of the worked example that has heard the geometry."""
    receiver = CReceiver(NONCE, key=KEY, max_cells=101 * 101)
    assert receiver.feed_datagram(1.0, with_tag("geom"))
    return receiver


def with_tag(name: str) -> bytes:
    """A frame that the protocol prints without one."""
    frame = frame_from_bytes(vector(name))
    assert not isinstance(frame, str)
    numbers = frame.type, frame.seq, frame.t_ms, frame.body
    return signed_bytes_from_frame(*numbers, KEY, 0x5A17C0DE, NONCE)


def test_the_map_of_the_worked_example_stands_as_printed() -> None:
    receiver = begun()
    expected = {(60, 40): 2, (60, 42): 2, (60, 43): 0, (61, 40): 2, (62, 39): 0, (62, 40): 1}
    expected |= {(62, 100): 1, (63, 0): 1, (63, 8): 1, (63, 9): 0}
    window = receiver.window()
    assert {at: int(window[at]) for at in expected} == expected
    assert [int((window == code).sum()) for code in (1, 2)] == [70, 6]
    assert receiver.origin == (196, -100)
    assert receiver.digest() == int(VECTORS["digest_crc"], 0)
    assert receiver.cell_at((196 + 40) * 0.05 + 0.01, (-100 + 60) * 0.05 + 0.01) == 2
    assert receiver.cell_at((196 + 40) * 0.05 - 0.01, (-100 + 60) * 0.05 + 0.01) == 0


def test_the_pose_of_the_worked_example_is_read_as_printed() -> None:
    pose = begun().pose
    assert pose is not None
    assert (pose.t_ms, pose.x_mm, pose.y_mm) == (1020, 12_340, -2_500)
    assert (pose.yaw, pose.pitch, pose.roll) == (7854, -52, 17)
    assert (pose.v_mmps, pose.w_mradps, pose.health, pose.mode) == (650, -120, 0x7F, 1)
    assert (pose.age_scan, pose.age_attitude, pose.age_encoders) == (3, 1, 2)


def test_the_way_for_big_endian_processors_reads_the_same() -> None:
    receivers = [CReceiver(NONCE, settings=words) for words in ((), ("-DMAPOD_LINK_BIG_ENDIAN",))]
    for receiver in receivers:
        for name in ("geom", "pose", "map", "geom"):
            receiver.feed_datagram(1.02, vector(name))
    poses = [bytes(receiver.pose) for receiver in receivers if receiver.pose]
    assert poses[0] == poses[1]
    states = [bytes(receiver.state(1.03)) for receiver in receivers]
    assert states[0] == states[1]
    assert (receivers[0].window() == receivers[1].window()).all()


def test_a_receiver_of_short_frames_that_only_asks_says_so_as_printed() -> None:
    short = ("-DMAPOD_FRAME_MAX=128u",)
    receiver = CReceiver(NONCE, max_cells=101 * 101, poll_only=True, settings=short)
    for _ in range(3):
        receiver.hello(1.0)
    assert receiver.hello(52.37).hex(" ") == VECTORS["hello_poll"]
    assert serial_from_frame(vector("hello_poll")) == vector("hello_poll_serial")
    assert not receiver.feed_datagram(1.0, bytes(129))
    assert receiver.rejected == {"length": 1}


def answers(receiver: CReceiver) -> dict[str, bytes]:
    """What the protocol prints as said by this receiver, in its order of numbers."""
    external = ExternalPose(105_250, -48_900, 12_345, 20, 30, -2_500, 175, 40)
    upright = ExternalPose(105_250, -48_900, 12_345, 20, 30, -2_500, 175, 40, 15, 1250, -52, 17, 35)
    told = {
        "ack": receiver.ack(52.31, 0.0013),
        "drive": receiver.drive(52.34, 0.65, -0.12, 0.3),
        "external_pose": receiver.external_pose(52.36, external),
        "hello": receiver.hello(52.37),
        "ask_tile": receiver.ask(52.38, Ask(0x102, 0x08, 1, *RECTANGLE)),
        "ask_now": receiver.ask(52.39, Ask(0x103, 0x07, 0, *RECTANGLE)),
        "ask_window": receiver.ask(52.4, Ask(0x104, 0x88, 0, 40, 60, 5, 3)),
    }
    receiver.ask(52.41, Ask(0x105, 0x01))  # has the number of an ASK for a scan, which it never is
    return {**told, "external_pose_upright": receiver.external_pose(52.42, upright)}


def test_each_answer_is_built_as_printed() -> None:
    receiver = CReceiver(NONCE, max_cells=101 * 101)
    for name in ("geom", "pose", "map"):
        receiver.feed_datagram(52.309, vector(name))
    receiver.say("suspect")  # set in the printed ACK to show the bit
    for name, told in answers(receiver).items():
        assert told.hex(" ") == VECTORS[name], name
        assert serial_from_frame(told).hex(" ") == VECTORS[f"{name}_serial"]


def test_each_authenticated_answer_is_built_as_printed() -> None:
    told = answers(keyed())
    del told["ack"]  # of other frames than those printed
    assert told.pop("hello") == with_tag("hello")
    for name, frame in told.items():
        assert frame.hex(" ") == VECTORS.get(f"{name}_auth", VECTORS[name]), name
    newcomer = CReceiver(NONCE, key=KEY, max_cells=101 * 101)  # which knows no session
    assert newcomer.hello(1.0)[1] == 0


def test_the_digest_of_the_worked_example_agrees() -> None:
    receiver = begun()
    receiver.feed_datagram(1.1, vector("digest"))
    assert receiver.state(1.1).digest_ok
    assert not receiver.state(1.1).need_full


def test_the_stop_zone_is_read_as_printed() -> None:
    receiver = begun()
    receiver.feed_datagram(1.1, vector("stop_zone"))
    zone = receiver.zone
    assert (zone.free_ahead_mm, zone.obstacle_ahead_mm) == (1250, 1480)
    assert (zone.free_behind_mm, zone.obstacle_behind_mm, zone.contact_ms) == (0, 65_535, 1920)
    assert (zone.allowed_ahead_mmps, zone.allowed_behind_mmps) == (650, 0)
    assert (zone.nearest_mm, zone.bearing) == (430, -7854)
    assert (zone.state, zone.causes) == (2, 3)
    assert receiver.zone_advice(1.3) == "slow"
    assert receiver.zone_advice(1.5) == "stop"


FROM_CELL_5 = ("tile_variance", "tile_edge")
TILES = {
    "tile_class": [2, 2, 2, 0, 0, 2, 2, 2, 0, 0, 1, 1, 1, 1, 1],
    "tile_height": [152, 149, 151, None, None, 40, 148, 150, None, None, 3, -2, 0, 1, -4],
    "tile_variance": [400, 25, 30, None, None, 9, 9, 9, 10, 65_534],
    "tile_slope": [7854, 7850, 7860, None, None],
    "tile_refused": [],
    "tile_cause": [],  # for tools: taken, and left alone
    "tile_z": [],
    "tile_edge": [],
    "tile_foothold": [],
}


@pytest.mark.parametrize("name", list(TILES))
def test_a_tile_is_read_as_printed(name: str) -> None:
    receiver = begun()
    receiver.feed_datagram(1.1, vector(name))
    piece = receiver.piece
    assert (piece.i, piece.j, piece.width, piece.height) == RECTANGLE
    assert (piece.geom_id, piece.cell_mm, piece.id) == (7, 50, 0x102)
    assert (piece.status, piece.first) == (int("refused" in name), 5 * (name in FROM_CELL_5))
    values = [None if v == NOT_KNOWN else v for v in piece.values[: piece.count]]
    assert values == TILES[name]
