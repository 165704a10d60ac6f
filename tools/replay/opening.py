"""Devices as they were when a file began that begins in the middle of a run.

Such a file has at its head what each port's newest connection began with, minutes or days before.
Each device is played that alone, and up to its first measurement: it has asked, was answered, and
is set up. The time between is left out, so that no device has been silent. Nothing was measured
yet, so that clocks and counters begin with the file's own bytes, as after a start.
"""

from typing import Any

from core.config import Config
from hw.ax3500.session import Ax3500Options
from recording.reader import Recording
from recording.records import CHANGED, IN, OUT, Record, RecordingError
from tools.replay.heard_drive import heard_ax3500
from tools.replay.ports import DEVICES, PlayedPort, became_from_bytes, played_ports
from wiring import Devices, Ports, devices_on

TICK_S = 0.005  # a device that starts is stepped so often
LONGEST_S = 20.0  # between two records: then its connection would have been dropped as dead
UNKNOWN_BEFORE = (
    "it begins in the middle of a run: the map is unknown at its begin, so that what planners got "
    "is not compared"
)
NOT_PLAYABLE = (
    "it begins in the middle of a run: what its devices had answered before is not in it, so it "
    "can't be played; its maps are in it for Foxglove, see docs/recording.md"
)
SECTIONS = "scanner", "ahrs", "drive"  # of the settings, in the order of ports


def opened_devices(
    recording: Recording, ports: list[PlayedPort], config: Config
) -> tuple[Devices, list[str]]:
    """The devices on the first of these ports, set up as they were; remarks for a person.

    Raises:
        RecordingError: the file does not say how. OSError.
    """
    records = recording.opening()
    first = next(recording.records(), None)
    if recording.metadata.get("opening", "0") == "0":
        raise RecordingError(f"{recording.path}: {NOT_PLAYABLE}")
    if first is None:
        raise RecordingError(f"{recording.path} was cut off before all that could be played")
    devices = devices_of(ports, config)
    for k, port in enumerate(ports):
        own = [record for record in records if record.port == k]
        if k < DEVICES:
            count = count_before_measuring(recording, config, k, own)
            own, rest = own[:count], own[count:]
            shift_s = max(0.0, first.t_s - TICK_S - own[-1].t_s) if own else 0.0
            played(devices.by_section[SECTIONS[k]], port, own, shift_s)
            own = rest
        become(port, own)
    return devices, [UNKNOWN_BEFORE]


def devices_of(ports: list[PlayedPort], config: Config) -> Devices:
    """Those that the settings name; a controller that answers is overheard."""
    scanner, ahrs, drive, *planners = ports
    devices = devices_on(Ports(scanner, ahrs, drive, planners[0]), config)
    if isinstance(config.drive.options, Ax3500Options):
        devices = devices._replace(drive=heard_ax3500(drive, config.drive.options, config))
    return devices


def count_before_measuring(
    recording: Recording, config: Config, number: int, records: list[Record]
) -> int:
    """How many of a port's records go by before its device measures; all, if it never does."""
    ports = played_ports(recording, config)
    device = devices_of(ports, config).by_section[SECTIONS[number]]
    return played(device, ports[number], records, 0.0)


def played(device: Any, port: PlayedPort, records: list[Record], shift_s: float) -> int:
    """A device alone with these records, that much later; ends at its first measurement.

    Returns:
        how many of them it took before that.
    """
    now_s = records[0].t_s + shift_s if records else 0.0
    for k, record in enumerate(records):
        t_s = record.t_s + shift_s
        now_s = max(now_s, t_s - LONGEST_S)
        while now_s + TICK_S < t_s:
            now_s += TICK_S
            if device.step(now_s):
                return k
            port.end_call()
        now_s = max(now_s, t_s)
        if record.kind == IN:
            port.arrives(record.data)
        elif record.kind == CHANGED:
            port.becomes(became_from_bytes(record.data))
        elif record.kind != OUT:  # which the app wrote at a tick of its own
            continue
        if device.step(now_s):
            return k
        port.end_call()
    return len(records)


def become(port: PlayedPort, records: list[Record]) -> None:
    """What a port became by these."""
    for record in records:
        if record.kind == CHANGED:
            port.becomes(became_from_bytes(record.data))
    port.end_call()
