"""`mapod attitude` against a fake sensor, on a simulated line."""

import pytest

from tests.support.real_time import level_sensor
from tests.support.simulated_lines import SimulatedLines
from tools.cli import attitude


def said(capsys: pytest.CaptureFixture[str], path: str, *what: str) -> str:
    """What the tool prints when it does what it was told."""
    status = attitude.main([*what, "--port", f"serial://{path}?baud=115200"])
    printed = capsys.readouterr()
    assert status == 0, printed.err
    return printed.out


def test_it_tells_who_the_sensor_is_and_lets_it_measure_on(
    capsys: pytest.CaptureFixture[str], lines: SimulatedLines
) -> None:
    sensor = level_sensor()
    told = said(capsys, lines.serial(sensor), "info")
    assert "product MTi-28A53G35" in told
    assert "100 messages a second" in told
    assert "scenario 3: machine (version 8)" in told
    assert "in use: 3" in told
    assert sensor.state.value == "measuring"


def test_a_profile_is_chosen_among_those_offered_only(
    capsys: pytest.CaptureFixture[str], lines: SimulatedLines
) -> None:
    path = lines.serial(level_sensor())
    offered = [
        int(line.split()[1].rstrip(":"))
        for line in said(capsys, path, "scenarios").splitlines()
        if line.startswith("scenario")
    ]
    assert f"in use: {offered[-1]}" in said(capsys, path, "scenario", str(offered[-1]))
    assert attitude.main(["scenario", "200", "--port", f"serial://{path}?baud=115200"]) == 1
    assert f"must be one of {offered}, is 200" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["heading-reset", "object-reset", "alignment-reset"])
@pytest.mark.parametrize("keep", [False, True])
def test_a_reset_is_stored_only_if_told_so(
    name: str, keep: bool, capsys: pytest.CaptureFixture[str], lines: SimulatedLines
) -> None:
    sensor = level_sensor(yaw_rad=0.5)
    before = sensor.memory.G_reset.copy(), sensor.memory.A_reset.copy()
    told = said(capsys, lines.serial(sensor), name, *(["--keep"] if keep else []))
    assert ("stored" in told) == keep
    after = sensor.memory.G_reset, sensor.memory.A_reset
    changed = any((a != b).any() for a, b in zip(after, before, strict=True))
    assert changed == keep


def test_the_self_test_and_a_baud_rate_are_told(
    capsys: pytest.CaptureFixture[str], lines: SimulatedLines
) -> None:
    sensor = level_sensor()
    path = lines.serial(sensor)
    assert said(capsys, path, "self-test") == "all passed\n"
    sensor.self_test = 0x00FE
    assert said(capsys, path, "self-test") == "failed: acceleration x, magnetic field z\n"
    assert "still for 5 s" in said(capsys, path, "still", "5")
    assert attitude.main(["still", "65536", "--port", f"serial://{path}?baud=115200"]) == 2
    assert "within 0..65535" in capsys.readouterr().err
    assert "921600 baud from its next power-up" in said(capsys, path, "baud", "921600")


def test_silence_and_wrong_use_are_told_in_words(
    capsys: pytest.CaptureFixture[str], lines: SimulatedLines
) -> None:
    sensor = level_sensor()
    sensor.mute = True
    assert attitude.main(["info", "--port", f"serial://{lines.serial(sensor)}?baud=115200"]) == 1
    assert "no answer" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        attitude.main(["baud", "12"])
    assert "115200" in capsys.readouterr().err
    assert attitude.main(["info", "--port", "nowhere"]) == 2
    assert "nowhere" in capsys.readouterr().err
