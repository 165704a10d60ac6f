"""`mapod attitude` against a fake sensor, on a simulated line."""

import pytest

from tests import Capsys
from tests.support.devices.simulated_lines import Said, SimulatedLines
from tests.support.machine.real_time import level_sensor
from tools.cli import attitude


@pytest.fixture
def said(capsys: Capsys, lines: SimulatedLines) -> Said:
    return Said(capsys, lines, attitude.main, "baud=115200")


def test_it_tells_who_the_sensor_is_and_lets_it_measure_on(said: Said) -> None:
    sensor = level_sensor()
    told = said(sensor, "info")
    assert "product MTi-28A53G35" in told
    assert "100 messages a second" in told
    assert "scenario 3: machine (version 8)" in told
    assert "in use: 3" in told
    assert sensor.state.value == "measuring"


def test_a_profile_is_chosen_among_those_offered_only(said: Said) -> None:
    sensor = level_sensor()
    listed = said(sensor, "scenarios").splitlines()
    offered = [int(row.split()[1].rstrip(":")) for row in listed if row.startswith("scenario")]
    assert f"in use: {offered[-1]}" in said(sensor, "scenario", str(offered[-1]))
    assert f"must be one of {offered}, is 200" in said(sensor, "scenario", "200", status=1)


@pytest.mark.parametrize("name", ["heading-reset", "object-reset", "alignment-reset"])
@pytest.mark.parametrize("keep", [False, True])
def test_a_reset_is_stored_only_if_told_so(name: str, keep: bool, said: Said) -> None:
    sensor = level_sensor(yaw_rad=0.5)
    before = sensor.memory.G_reset.copy(), sensor.memory.A_reset.copy()
    assert ("stored" in said(sensor, name, *(["--keep"] if keep else []))) == keep
    after = sensor.memory.G_reset, sensor.memory.A_reset
    assert any((a != b).any() for a, b in zip(after, before, strict=True)) == keep


def test_the_self_test_and_a_baud_rate_are_told(said: Said) -> None:
    sensor = level_sensor()
    assert said(sensor, "self-test") == "all passed\n"
    sensor.self_test = 0x00FE
    assert said(sensor, "self-test") == "failed: acceleration x, magnetic field z\n"
    assert "still for 5 s" in said(sensor, "still", "5")
    with pytest.raises(SystemExit, match="2"):
        said(sensor, "still", "65536", status=2)
    assert "921600 baud from its next power-up" in said(sensor, "baud", "921600")


def test_a_new_baud_rate_lets_the_sensor_measure_on_until_its_next_power_up(said: Said) -> None:
    sensor = level_sensor(model="MTi-30")
    assert "14400 baud from its next power-up" in said(sensor, "baud", "14400")
    assert (sensor.state.value, sensor.baud) == ("measuring", 115_200)


def test_silence_is_told_in_words(said: Said) -> None:
    sensor = level_sensor()
    sensor.mute = True
    assert "no answer" in said(sensor, "info", status=1)
