"""`tools/compare`: fakes against fakes that differ in one thing, and against recorded bytes."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fakes.ax3500.device import FakeAx3500
from fakes.lms1xx.device import FakeLms111
from fakes.lms1xx.recorded import RecordedLms111
from fakes.wires.wire import Fake, TcpWire
from tests import Capsys
from tests.support.devices.simulated_lines import SimulatedLines
from tests.support.machine.real_time import StillWheels, level_sensor, served
from tools.cli import compare, scanner
from tools.compare.facts import Difference, Fact, delay_fact, differences, pace_facts

SECONDS = 0.5
FORM = "&parity=E&bytesize=7"


def a_scanner(model: str = "LMS111") -> FakeLms111:
    fake = FakeLms111(lambda t_s, times_s, bearings_rad: np.full(len(times_s), 5.0), 1, model)
    fake.measures_at_power_up = True
    return fake


def a_controller() -> FakeAx3500:
    return FakeAx3500(StillWheels(), 1, "rs232_watchdog")


Held = Callable[..., list[list[Difference]]]


@pytest.fixture
def held(lines: SimulatedLines) -> Held:
    """What the tool finds different about each of the others, held against the first."""

    def hold(device: str, *fakes: Fake) -> list[list[Difference]]:
        first, *others = (
            compare.LOOKS[device](url_of(device, lines, fake), SECONDS, False) for fake in fakes
        )
        return [differences(first, other) for other in others]

    return hold


def url_of(device: str, lines: SimulatedLines, fake: Fake) -> str:
    if device == "scanner":
        return f"tcp://{lines.tcp(fake)}"
    baud, form = (9600, FORM) if device == "drive" else (115_200, "")
    return f"serial://{lines.serial(fake)}?baud={baud}{form}"


def named(found: list[Difference]) -> str:
    """The differences that count, as one text."""
    return "\n".join(f"{one.name}: {one.real} / {one.fake}" for one in found if one.counts)


def timeless(found: list[Difference]) -> str:
    """Those that do not depend on how busy this machine is: no delays, no rates."""
    timed = (" ms", " 1/s")
    return named([one for one in found if not (one.real + one.fake).endswith(timed)])


def other(fake: Any, attribute: str, value: object) -> Any:
    setattr(fake, attribute, value)
    return fake


@pytest.mark.parametrize(
    ("device", "made", "changes"),
    [
        (
            "scanner",
            a_scanner,
            {
                ("refuse", "LCMstate"): "sRN LCMstate: answer: sRA / refused",
                ("drop_rate", 0.3): "scan: steps of scan_counter: always 1 / not always 1",
                ("slow_answer_s", 0.15): "sRN DeviceIdent: delay",
                ("binary", False): "dialect: binary / ascii",
                ("noise_m", 0.1): "scan: noise of a range, median",
            },
        ),
        (
            "ahrs",
            level_sensor,
            {
                ("lost_rate", 0.3): "sample: steps of the counter: always 1 / not always 1",
                ("length_off", 1): "stream: data bytes each: 18 / 19",
                ("angle_noise_rad", 0.01): "sample: noise of q_earth_sensor",
                ("nan", True): "sample: readable by mode and settings: all / not all",
            },
        ),
        (
            "drive",
            a_controller,
            {
                ("plus_after_read", False): "^00: answer: 2 digits, + / 2 digits",
                ("reply_delay_s", 0.1): "counters: pairs a second",
                ("mode", "rc"): "as found: quiet / sends logging lines",
            },
        ),
    ],
)
def test_what_one_device_of_a_kind_does_otherwise_is_found(
    device: str, made: Callable[[], Fake], changes: dict[tuple[str, Any], str], held: Held
) -> None:
    fakes = [
        other(made(), attribute, {value: 5} if attribute == "refuse" else value)
        for attribute, value in changes
    ]
    alike, *found = held(device, made(), made(), *fakes)
    assert named(alike) == ""
    for one, says in zip(found, changes.values(), strict=True):
        assert says in named(one)


def test_slow_answers_are_not_taken_for_those_of_the_next_question(held: Held) -> None:
    slow = other(other(a_controller(), "reply_delay_s", 0.06), "lf_after_cr", True)
    [found] = held("drive", a_controller(), slow)
    assert timeless(found) == ""


def test_rates_and_unevenness_of_arrival_are_held_against_each_other() -> None:
    times_s = np.arange(500) * 0.01
    even = dict(pace_facts("stream", list(times_s)))
    late_s = 0.02 * np.abs(np.sin(times_s * 77.0))
    uneven = differences(even, dict(pace_facts("stream", list(times_s + late_s))))
    assert [one.name for one in uneven] == ["stream: unevenness of arrival, p95"]
    faster = differences(even, dict(pace_facts("stream", list(times_s * 0.99))))
    assert [one.name for one in faster] == ["stream: rate"]
    assert differences(even, dict(pace_facts("stream", list(times_s * 0.9999)))) == []


def test_the_recorded_scanner_and_the_fake_agree(vectors: Path, held: Held) -> None:
    recorded = RecordedLms111.from_files(vectors / "lms111_session_d2h.bin")
    [all_found] = held("scanner", recorded, a_scanner())
    found = [one for one in all_found if one.counts and one.name in timeless([one])]
    in_stream = [one for one in found if one.name.startswith(("scan", "subscription"))]
    assert {one.name for one in in_stream} <= IN_A_RECORDING, in_stream
    asked = [one for one in found if one not in in_stream]
    answers = [one for one in asked if one.name.endswith(": answer")]
    assert answers, "the recording holds the answers of one start-up, and no others"
    # it had logged in: the recording answers what the fake refuses to a stranger
    known = [one for one in answers if "without login" not in one.name]
    assert all(one.real.startswith("refused") for one in known), known


IN_A_RECORDING = {
    "scan: device status",
    "scan: clock",  # it was recorded without the time block
}


@pytest.mark.real_time
def test_it_starts_a_fake_set_as_the_real_one(tmp_path: Path, capsys: Capsys) -> None:
    real = a_scanner()
    wire, path = TcpWire(real), tmp_path / "facts.json"
    with served(wire):
        url = f"tcp://127.0.0.1:{wire.port}"
        scanner.main(["start", "--port", url])
        status = compare.main(["scanner", "--port", url, "--seconds", "1", "--out", str(path)])
    printed = capsys.readouterr()
    facts = json.loads(path.read_text(encoding="utf-8"))
    real_facts, fake_facts = (
        {name: Fact(**fact) for name, fact in facts[side].items()} for side in ("real", "fake")
    )
    assert "scan DIST1: layout" in real_facts
    found = differences(real_facts, fake_facts)
    assert timeless(found) == "", printed.out + printed.err
    assert status == (1 if any(one.counts for one in found) else 0)


def test_who_does_not_answer_is_told_in_words(capsys: Capsys, lines: SimulatedLines) -> None:
    silent, other_one = level_sensor(), level_sensor()
    silent.deaf = True
    url, fake = url_of("ahrs", lines, silent), url_of("ahrs", lines, other_one)
    assert compare.main(["ahrs", "--port", url, "--fake", fake]) == 2
    assert "no answer to GoToConfig" in capsys.readouterr().err
    assert compare.main(["ahrs", "--port", "nowhere"]) == 2
    assert compare.main(["planner", "--port", "udp://127.0.0.1:9751"]) == 2
    assert "mapod link-test --port udp://127.0.0.1:9751" in capsys.readouterr().err


def test_facts_agree_within_what_a_line_and_a_machine_make_of_them() -> None:
    one = {"delay": delay_fact(0.004), "id": Fact("7", "own"), "answer": Fact("sRA")}
    same = {"delay": delay_fact(0.015), "id": Fact("7", "own"), "answer": Fact("sRA")}
    assert differences(one, same) == []
    other = {"delay": delay_fact(0.4), "id": Fact("8", "own"), "extra": Fact(2.5, unit="m")}
    assert [(found.name, found.counts) for found in differences(one, other)] == [
        ("delay", True),
        ("id", False),
        ("answer", True),
        ("extra", True),
    ]
