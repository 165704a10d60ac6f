"""Receiver of the mapod planner link, version 1: for planners and tools written in Python.

It needs Python 3.11 and numpy, and nothing else of this repository: the folder may be copied as it
is. The protocol is described in docs/protocols/planner-link.md. There are three ways in, each on
top of the next one.

**On a wire**, ten lines; the URL is the one that mapod's setting `planner.port` names:

    from mapod_link import OBSTACLE, open_link

    with open_link("udp://0.0.0.0:9750") as link:
        while True:
            link.update(0.1)  # takes frames, acknowledges them; to be called ten times a second
            advice, why = link.advice()  # "go", "slow" or "stop": to be obeyed
            known = link.receiver
            if advice != "stop" and known.pose is not None:
                obstacles = (known.cells == OBSTACLE).nonzero()  # rows along y, columns along x
                print(known.pose.x_m, known.pose.y_m, known.origin, len(obstacles[0]), why)

**Without a wire**, for a program that has its own loop: `Receiver`. Bytes in (`feed_datagram` for
UDP, `feed_stream` for a serial line), bytes out (`poll`), time as an argument:

    >>> from mapod_link import FREE, OBSTACLE, Receiver
    >>> receiver = Receiver(nonce=0x11223344)
    >>> for frame in (
    ...     "11 00 01 00 e8 03 00 00 07 00 65 00 65 00 32 00 de c0 17 5a 14 00 96 00 f1 c9 34 1c",
    ...     "12 01 02 00 fc 03 00 00 34 30 00 00 3c f6 ff ff ae 1e cc ff 11 00 8a 02 88 ff 7f 00"
    ...     "03 01 02 01 76 6e 3b f7",
    ...     "13 00 03 00 fc 03 00 00 c4 00 9c ff 00 00 07 d4 17 00 82 ff 22 82 ff 22 7f 06 67 be"
    ...     "f8 7b",
    ... ):
    ...     _ = receiver.feed_datagram(10.0, bytes.fromhex(frame))
    >>> receiver.cells.shape, receiver.origin, receiver.geom.cell_m
    ((101, 101), (196, -100), 0.05)
    >>> receiver.cell(40, 60) == OBSTACLE, receiver.cell(8, 63) == FREE
    (True, True)
    >>> receiver.advice(10.02), receiver.advice(10.2)
    (('go', ''), ('stop', 'link stale'))
    >>> [frame.hex(" ")[:11] for frame in receiver.poll(10.02)]  # the ACK
    ['18 00 01 00']

**Objects**, outlines with heights, come besides where the sender knows any:

    >>> objects = bytes.fromhex(
    ...     "1d 01 13 00 60 04 00 00 07 00 02 00 01 00 50 00 39 79 1d 8a 01 00 00 00 00 00 00 00 50"
    ...     "00 03 03 02 01 00 00 0e 38 00 00 50 fb ff ff 00 00 cc 06 58 02 06 ff cc 00 01 00 6a ff"
    ...     "38 ff 96 00 38 ff 00 00 c8 00 dc 05 01 04 03 00 00 00 10 27 00 00 48 f4 ff ff 00 00 d0"
    ...     "02 00 00 00 00 cc 00 01 00 70 fe d4 fe 90 01 d4 fe 90 01 2c 01 70 fe 2c 01 00 00 00 00"
    ...     "02 00 00 00 d7 0e e1 7b"
    ... )
    >>> receiver.feed_datagram(10.03, objects)
    True
    >>> for one in receiver.vectors.fresh_objects(10.04):
    ...     print(one.id, one.moves, one.top_m, one.outline_m[0])
    258 True 1.74 [14.2 -1.4]
    3 False 0.72 [ 9.6 -3.3]
    >>> receiver.vectors.objects_state(10.04)  # of this list something may be missing
    ('suspect', '1 objects are still to be told')

**Frames only**: `mapod_link.frames`, `serial_line` (COBS), `bodies`, `asking` and `tiles` turn
bytes into records and back.

What a planner has to know:

- Cells are 0 UNKNOWN, 1 FREE, 2 OBSTACLE; UNKNOWN is not FREE. `cells[row, column]`: columns along
  map x, rows along map y; `cells[0, 0]` is world cell `origin`; the window moves with the robot.
- All lengths are metres, angles radians, times seconds; the pose is that of the map frame, x ahead
  and y to the left of where the robot began.
- First comes `advice`, what section 5 of the protocol demands: "stop" while the map is missing,
  stale, known to be wrong or not to be trusted, "slow" while a lost frame may hide an obstacle.
  Where it lets the robot go, `allowed_mps` says how fast straight ahead and straight back, by the
  sender's own judgement (`stop_zone`); (0, 0) while it does not know.
- `Receiver.drive` asks the robot to move, for up to a second; the sender obeys only while it knows
  nothing against it. `Receiver.external_pose` tells what a positioning system has seen.
- `Receiver.ask_tile` asks for a rectangle of one layer: class, height, variance, slope, z, age, the
  cause for which a cell is what it is, or for feet the way to the next edge, how good a foothold it
  is, and heights filled in with their sigmas; what gets lost is asked for again.
  `Receiver.ask_scan` asks for the points of the newest sweep. With `poll_only` nothing is pushed,
  and that is all.
- `Receiver.vectors` has the objects that the sender knows (outlines with heights) and the path,
  where it tells of them. `objects_state` and `path_state` say whether they may be outdated;
  `fresh_objects` leaves out what moved and was not seen for half a second. What is not in the list
  is not therefore free.
- With a key of 32 bytes, frames without a valid tag are refused, and answers are signed.
- Nothing raises on what arrives. `OSError`: the wire is gone. `ValueError`: a wrong argument.
"""

from mapod_link.bodies import FREE, OBSTACLE, UNKNOWN, Geometry, Pose, StopZone
from mapod_link.client import Link, open_link
from mapod_link.objects import LinkObject
from mapod_link.receiver import Receiver
from mapod_link.scans import SweepPoints
from mapod_link.serial_line import serial_from_frame
from mapod_link.tiles import Tile

__all__ = [
    "FREE",
    "OBSTACLE",
    "UNKNOWN",
    "Geometry",
    "Link",
    "LinkObject",
    "Pose",
    "Receiver",
    "StopZone",
    "SweepPoints",
    "Tile",
    "open_link",
    "serial_from_frame",
]
