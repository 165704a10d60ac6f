"""Every fault that the fake Hokuyo can be given while the robot of robots/urg04lx.toml drives.

What such a fake can be told and is no fault stands in NO_FAULTS_URG04LX, with the reason.
Source of what must come: docs/devices.md, docs/maps.md.
"""

from dataclasses import replace

from tools.rig.faults.catalogue import (
    BLIND,
    LATER,
    LATER_S,
    Fault,
    either,
    goes_on,
    stops,
    wire_faults,
)

ROBOT = "urg04lx"
NO_SCAN = "no scan for some periods: the input is stale, free cells are taken back"
NEXT = "a scan or two are missing; with more of them the input is stale"
AT_ONCE = "its stream ends: 0.4 s later it is looked for, and a second later it measures"
QUESTIONS = "nothing waits for an answer while it runs"
BLACK = "black floor gives nothing back, as a drop; nearer, no beam looks at it again"
BEAM = "one beam in hundreds"
LASER_OFF = ("scanner.switch_laser_off",)
RESTART = ("scanner.restart",)

_SCANNER = (
    *wire_faults("scanner", ("mute",), NO_SCAN, "0.00005", 75_000),
    stops("scanner.mute", NO_SCAN),
    goes_on("scanner.deaf", "it streams on, and nothing is asked of it"),
    either("scanner.late_s", LATER, "0.03", recovers_s=LATER_S),
    either("scanner.late_s", LATER, "0.5", recovers_s=LATER_S),
    goes_on("scanner.slow_answer_s", QUESTIONS, "0.8"),
    goes_on("scanner.answers_lost", QUESTIONS, "3"),
    either("scanner.damaged_rate", NEXT, "0.2"),
    stops("scanner.damaged_rate", NO_SCAN, "1"),
    either("scanner.lost_line_rate", NEXT, "0.2"),
    stops("scanner.lost_line_rate", NO_SCAN, "1"),
    either("scanner.cut_next", NEXT, lasts_s=0.5),
    either("scanner.frozen", f"{BLIND}: the same ranges with new times"),
    goes_on("scanner.drift_ppm", "its clock is followed", "200"),
    either("scanner.noise", "floor that scatters may look like obstacles", "3"),
    goes_on("scanner.offset_m", "as far off as its sheet allows", "0.03"),
    goes_on("scanner.mixed", "edges that are seen clean", "off"),
    either("scanner.remission", BLACK, "0.05", again=False),
    goes_on("scanner.remission_at.384", BEAM, "0.05"),
    goes_on("scanner.values_at.384", BEAM, "0"),
    stops("scanner.trouble", "it says that it has stopped to check an error", "21"),
    stops("scanner.trouble", "it says that it has trouble with its hardware", "63"),
    stops("scanner.switch_laser_off", AT_ONCE, lasts_s=0.0, recovers_s=2.0),
    stops("scanner.restart", "it measures soon, its clock is known later", lasts_s=0.0),
    either("scanner.leave_streaming", "a stream that was not asked for", lasts_s=0.0),
    stops("scanner.laser_fails", "its laser goes off, and not on again", then=LASER_OFF),
    stops("scanner.refuse.MD", "it refuses to measure", "0A", then=LASER_OFF),
    stops("scanner.updates_firmware", "it waits for new firmware", then=LASER_OFF),
    stops("scanner.start_silent_s", "it starts anew, and is silent at first", "2", then=RESTART),
    stops("scanner.timer_ms", "it starts anew, its clock wraps soon", "16776000", then=RESTART),
    stops("scanner.splits_serial", "it starts anew; its serial number is torn", then=RESTART),
    stops("scanner.hangs_at_extensions", "it starts anew; it is asked for none", then=RESTART),
)  # fmt: skip
URG04LX: tuple[Fault, ...] = tuple(replace(fault, robot=ROBOT) for fault in _SCANNER)
NO_FAULTS_URG04LX = {"scanner.baud": "of a serial line: this one is on USB"}
