"""The machine: real-time rights, cores and their clock rates, the clocks, and room on the disk.

mapod itself uses the monotonic clock alone; the time of day stands in logs and recordings.
"""

import ctypes
import os
import resource
import shutil
from collections.abc import Iterator
from pathlib import Path

from hw.runtime.threads import FIFO_PRIORITY
from tools.doctor.finding import Finding

LOCKED_BYTES = 256 * 1024**2  # more than mapod locks, with the largest maps in use
ROOM_BYTES = 200 * 1024**2  # for a new version, or a recording
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies", "pit")
ADJTIMEX_BYTES, MAXERROR_AT, STATUS_AT = 208, 24, 40  # struct timex where a long has 8 bytes
UNSYNCHRONISED = 0x40  # bit of its status
CPUS = "sys/devices/system/cpu"
CLOCK = "sys/devices/system/clocksource/clocksource0/current_clocksource"


def find_machine(root: Path, folder: Path) -> Iterator[Finding]:
    """What can be read without asking anybody; `folder` is where mapod keeps its files."""
    yield of_cores(root)
    yield of_clock(root)
    yield of_time(*clock_state())
    yield of_room(shutil.disk_usage(folder).free, folder)


def of_cores(root: Path) -> Finding:
    """How many, and whether they keep their pace while there is little to do."""
    cores, governors = os.cpu_count() or 1, set()
    for path in sorted(root.glob(f"{CPUS}/cpu[0-9]*/cpufreq/scaling_governor")):
        governors.add(path.read_text(encoding="ascii").strip())
    if slow := sorted(governors - {"performance"}):
        advice = "The map may be late: echo performance | sudo tee /" + CPUS
        advice += "/cpu*/cpufreq/scaling_governor"
        return Finding("warning", "cores", f"{cores}, with the governor {slow[0]}", advice)
    return Finding("OK", "cores", str(cores))


def of_clock(root: Path) -> Finding:
    try:
        source = (root / CLOCK).read_text(encoding="ascii").strip()
    except OSError:
        return Finding("OK", "clock", "the system does not say which it uses")
    if source in SLOW_CLOCKS:
        advice = "Reading it takes microseconds: look for 'clocksource' in `sudo dmesg`"
        return Finding("warning", "clock", source, advice)
    return Finding("OK", "clock", source)


def clock_state() -> tuple[bool | None, float]:
    """Whether something keeps the time of day true, and its greatest error in seconds.

    None where the kernel does not say. Source: adjtimex(2).
    """
    answer = ctypes.create_string_buffer(ADJTIMEX_BYTES)  # all zero: only asks
    if ctypes.sizeof(ctypes.c_long) != 8 or ctypes.CDLL(None).adjtimex(answer) < 0:
        return None, 0.0
    error_us = int.from_bytes(answer.raw[MAXERROR_AT : MAXERROR_AT + 8], "little", signed=True)
    status = int.from_bytes(answer.raw[STATUS_AT : STATUS_AT + 4], "little")
    return not status & UNSYNCHRONISED, error_us * 1e-6


def of_time(synchronised: bool | None, error_s: float) -> Finding:
    if synchronised is None:
        return Finding("OK", "time", "the system does not say whether its time of day is kept true")
    if not synchronised:
        advice = "Logs and recordings may be dated wrong: sudo apt install chrony"
        return Finding("warning", "time", "the time of day is not synchronised", advice)
    return Finding("OK", "time", f"the time of day is synchronised, within {1000 * error_s:.0f} ms")


def of_room(free: int, folder: Path) -> Finding:
    says = f"{free / 1e6:.0f} MB free in {folder}"
    if free < ROOM_BYTES:
        advice = "A new version or a recording needs 200 MB: remove what is old"
        return Finding("warning", "disk", says, advice)
    return Finding("OK", "disk", says)


def rights_here() -> tuple[int, int]:
    """(FIFO priority, bytes to lock) that this process may have; -1 bytes: any number."""
    if os.geteuid() == 0:
        return 99, -1
    return resource.getrlimit(resource.RLIMIT_RTPRIO)[0], resource.getrlimit(
        resource.RLIMIT_MEMLOCK
    )[0]


def of_rights(priority: int, locked_bytes: int, whose: str) -> Finding:
    """Whether they suffice to be on time."""
    lacking = [] if priority == -1 or priority >= FIFO_PRIORITY else ["SCHED_FIFO"]
    lacking += [] if locked_bytes == -1 or locked_bytes >= LOCKED_BYTES else ["locked memory"]
    if lacking:
        advice = (
            f"Slots are missed under load: rtprio {FIFO_PRIORITY} and memlock unlimited in "
            "/etc/security/limits.d, or run the service (docs/service.md)"
        )
        return Finding("warning", "real time", f"{whose} has no {' and no '.join(lacking)}", advice)
    return Finding("OK", "real time", f"{whose} has SCHED_FIFO and locked memory")
