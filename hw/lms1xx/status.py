"""What a SICK LMS1xx says about itself: states, device status, contamination; what each means.

Source: lms111 sheet, sections 3 and 5.
"""

READY = 7
CONFIGURING, IDLE = 2, 3
STATES = {
    0: "undefined",
    1: "initialising",
    2: "being configured",
    3: "idle",
    4: "its mirror is speeding up",
    5: "in preparation",
    6: "ready, but not for measurement",
    7: "measuring",
}
CONFIG_FAULTS = {
    1: "bad frequency",
    2: "bad resolution",
    3: "bad frequency and resolution",
    4: "bad area",
}
CONTAMINATIONS = {
    1: "has a dirty window (warning): clean it",
    2: "has a dirty window (error): clean it",
    3: "has a window too dirty to see through: clean it",
}
TOO_DIRTY = 2  # contamination from which a scan's "nothing there" is not believed
HOT = "is out of its range of temperatures"


def describe_status(status: tuple[int, int]) -> str:
    values = f"{status[0]} {status[1]}"
    return f"sends scans with device status {values} (a warning, an error, or not valid yet)"
