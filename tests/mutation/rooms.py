"""The files that decide what is free and what may move, and the tests that answer for them."""

BEAMS = (
    "tests/core/mapping/beams/test_classifier.py",
    "tests/core/mapping/beams/test_floor_again.py",
    "tests/core/mapping/beams/test_carving.py",
    "tests/core/mapping/beams/test_elevation.py",
    "tests/core/mapping/beams/test_soft.py",
    "tests/core/mapping/beams/test_isolated.py",
    "tests/core/mapping/test_freshness.py",
    "tests/core/grid",
)
DRIVING = (
    "tests/core/driving/test_health.py",
    "tests/core/driving/test_stall.py",
    "tests/core/driving/test_stop_zone.py",
    "tests/core/driving/test_pilot.py",
    "tests/core/driving/test_zone.py",
    "tests/core/driving/test_control.py",
)
TESTS_OF = {  # the quickest first
    "core/mapping/beams/classifier.py": BEAMS,
    "core/mapping/beams/carving.py": BEAMS,
    "core/mapping/beams/negative.py": BEAMS,
    "core/mapping/freshness.py": BEAMS,
    "core/grid/window.py": BEAMS,
    "core/driving/control.py": DRIVING,
    "core/driving/corridor.py": DRIVING,
    "core/driving/health.py": DRIVING,
    "core/driving/pilot.py": DRIVING,
    "core/driving/report.py": DRIVING,
    "core/driving/stall.py": DRIVING,
    "core/driving/stop_zone.py": DRIVING,
    "core/driving/zone.py": DRIVING,
}
