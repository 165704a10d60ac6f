"""Every fault that the fake camera can be given while the robot of robots/ragno.toml drives.

What such a fake can be told and is no fault stands in NO_FAULTS_STRIPE, with the reason.
Source of what must come: docs/devices.md, docs/terrain.md.
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

ROBOT = "ragno"
NO_IMAGE = "no image for some periods: the input is stale, free cells are taken back"
NEXT = "an image or two are missing; with more of them the input is stale"
NO_LINE = "the camera sees no line of the laser"
LENS = f"{BLIND}: the line lies where other ground would have it"
PASSED = "ground that it has not seen stops it; nearer than its line no image looks at it again"
SIGHT = "the line is seen less well, or looks like obstacles"

_SCANNER = (
    *wire_faults("scanner", ("mute",), NO_IMAGE, "0.000002", 5_200_000),
    stops("scanner.mute", NO_IMAGE),
    either("scanner.late_s", LATER, "0.05", recovers_s=LATER_S),
    stops("scanner.late_s", "images that come too late are not used", "0.5", recovers_s=LATER_S),
    either("scanner.latency_s", LATER, "0.15", recovers_s=LATER_S),
    either("scanner.jitter_s", LATER, "0.05", recovers_s=LATER_S),
    goes_on("scanner.refuse", "it is asked for its stream only once", "503"),
    goes_on("scanner.tells_length", "the next boundary ends an image", "off"),
    either("scanner.tells_time", "the arrival counts then", "off", recovers_s=LATER_S),
    either("scanner.truncated_rate", NEXT, "0.2"),
    stops("scanner.truncated_rate", NO_IMAGE, "1"),
    either("scanner.torn_rate", NEXT, "0.2"),
    stops("scanner.torn_rate", NO_IMAGE, "1"),
    stops("scanner.frozen", "the very same image again is none"),
    stops("scanner.image_px", "images of another size are not used", "320,240"),
    goes_on("scanner.quality", "a coarser JPEG shows the line as well", "60"),
    either("scanner.rate_hz", "fewer images: each cell is looked at less often", "5"),
    stops("scanner.laser", NO_LINE, "0"),
    either("scanner.laser", SIGHT, "0.3"),
    stops("scanner.colour", NO_LINE, "green"),
    either("scanner.line_px", PASSED, "8", again=False),
    goes_on("scanner.speckle", "the centre of gravity is over the line's width", "0.5"),
    either("scanner.fan_deg", PASSED, "10", again=False),
    either("scanner.along", f"{BLIND}: a line up the image is one in few columns", "rows"),
    either("scanner.exposure", SIGHT, "0.3"),
    either("scanner.exposure", SIGHT, "4"),
    goes_on("scanner.auto_exposure", "the line stands out as well"),
    either("scanner.noise", SIGHT, "4"),
    stops("scanner.ambient", NO_LINE, "sun"),
    either("scanner.ambient", PASSED, "window", again=False),
    goes_on("scanner.ambient", "the laser is all the light that it needs", "dark"),
    either("scanner.reflectivity", SIGHT, "0.1"),
    either("scanner.texture", SIGHT, "0.9"),
    either("scanner.baseline_m", LENS, "0.121"),
    either("scanner.laser_deg", LENS, "11.2"),
    either("scanner.tilt_deg", LENS, "40.5"),
)  # fmt: skip
STRIPE: tuple[Fault, ...] = tuple(replace(fault, robot=ROBOT) for fault in _SCANNER)
NO_FAULTS_STRIPE = {
    "scanner.gone": "it is unplugged: of sockets that are dialled again (tests/app/test_stripe.py)",
    "scanner.repeated": "how many images are drawn: for more a second than a machine draws",
    "scanner.focal_px": "its lens: which one it is",
    "scanner.centre_px": "its lens: which one it is",
    "scanner.distortion": "its lens: which one it is",
    "scanner.mount_m": "where it sits: the rig sets it",
}
