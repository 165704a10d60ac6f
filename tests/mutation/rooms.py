"""The files that decide what is free and what may move, and the tests that answer for them.

Their tests run all branches of them (`coverage`), and see every mutant of them (`mutants`) that is
not listed as equivalent.
"""

SURFACE = "tests/core/mapping/surface/test_"
DRIVING = "tests/core/driving/test_"
TESTS_OF = {
    "core/mapping/along.py": ("tests/core/mapping/test_along.py",),
    "core/mapping/certainty/decision.py": ("tests/core/mapping/certainty/test_cells.py",),
    "core/mapping/surface/decision.py": (f"{SURFACE}decision.py", f"{SURFACE}soft.py"),
    "core/mapping/freshness.py": (
        "tests/core/mapping/test_freshness.py",
        "tests/core/mapping/test_carried.py",
    ),
    "core/grid/window.py": (
        "tests/core/grid/test_window.py",
        "tests/core/mapping/test_carried.py",
    ),
    "core/driving/control.py": (f"{DRIVING}control.py",),
    "core/driving/corridor.py": (f"{DRIVING}zone.py",),
    "core/driving/health.py": (f"{DRIVING}health.py",),
    "core/driving/monitor.py": (f"{DRIVING}monitor.py", f"{DRIVING}monitor_way.py"),
    "core/driving/pilot.py": (f"{DRIVING}pilot.py",),
    "core/driving/report.py": (f"{DRIVING}pilot.py",),
    "core/driving/stall.py": (f"{DRIVING}stall.py",),
    "core/driving/stop_zone.py": (f"{DRIVING}stop_zone.py",),
    "core/driving/zone.py": (f"{DRIVING}zone.py",),
}
