"""The driver against the fake camera: images at their instants, and in words what is wrong."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fakes.visionary.control import Desk
from fakes.visionary.models import KINDS, Model
from hw.visionary.camera import BLIND
from hw.visionary.frames import SAME_NUMBER, SAME_PICTURE
from hw.visionary.session import (
    ASKED,
    CONNECT_S,
    LEAST_SILENCE_S,
    LOGIN_S,
    LOST_PERIODS,
    State,
)
from hw.visionary.times import FORGET_S
from tests.support.devices.bench_visionary import Bench, points_of

BACK_S = 1.0  # within which it delivers again once a wire is back


def begun(model: Model = "t_mini", **given: Any) -> Bench:
    bench = Bench(model, **given)
    assert bench.run(0.8)
    assert bench.told == ("running", "")
    return bench


@pytest.mark.parametrize("model", list(KINDS))
def test_each_model_gives_images_of_the_world_at_their_instants(model: Model) -> None:
    bench = Bench(model)
    bench.fake.flying = bench.fake.multipath = 0.0
    bench.fake.noise = 0.1  # without any, pictures would be the same
    images = bench.run(1.5)
    assert bench.told == ("running", "")
    assert bench.camera.identity.startswith(KINDS[model].ident)
    assert len(images) >= 20
    assert bench.camera.status.missed == bench.camera.status.rejected == 0
    instants_s = np.array([image.t_s for image in images])
    exposed_s = np.array(bench.fake.exposed_s)
    nearest = np.abs(instants_s[:, None] - exposed_s).min(axis=1)
    assert nearest[20:].max() < 0.005  # jitter, and ticks
    assert len({id(image.camera) for image in images}) == 1
    image = images[-1]
    assert bench.fake.truth is not None
    assert image.numbers.shape == bench.fake.truth.raw.shape
    from_lens = points_of(image) - np.array(image.camera.offset_m)
    off = np.linalg.norm(from_lens, axis=2) - bench.fake.truth.truth_m
    assert np.nanmax(np.abs(off)) < 0.003
    assert np.isfinite(off).mean() > 0.95
    assert not image.numbers.flags.writeable
    assert not image.camera.rays.flags.writeable
    assert image.camera.offset_m == (-KINDS[model].away_mm / 1000, 0.0, 0.0)


def test_it_sets_the_period_and_logs_out_so_that_the_camera_streams() -> None:
    bench = begun(period_s=0.1)
    assert bench.fake.memory.period_s == pytest.approx(0.1)
    assert not bench.fake.desk.is_occupied
    images = bench.run(1.0)
    assert len(images) == 10
    assert {b.counter - a.counter for a, b in pairwise(images)} == {1}


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"password": "wrong"}, "the password is wrong"),
        ({"level": "none"}, 'level is "none", so nothing is set'),
        ({"level": "operator"}, "it must not be written without logging in (error A)"),
    ],
)
def test_what_could_not_be_set_is_a_remark_and_frames_come(given: dict[str, Any], why: str) -> None:
    bench = Bench(period_s=0.1, **given)
    assert bench.run(1.0)
    assert bench.told == ("running", f"the camera keeps 50 ms a frame: {why}")


def test_the_older_login_and_other_variants_are_known() -> None:
    bench = Bench(period_s=0.1)
    bench.fake.has_old_login, bench.fake.unknown = True, "BlobTcpPortAPI"
    assert bench.run(1.0)
    assert bench.told == ("running", "")
    assert bench.numbers == [2114]


def test_a_camera_of_the_older_protocol_may_know_the_newer_login_alone() -> None:
    bench = Bench("s")
    bench.fake.unknown = "SetAccessMode"
    bench.fake.memory.written["BlobTransportProtocolAPI"] = b"\x01"
    assert bench.run(1.0)
    assert bench.fake.memory.written["BlobTransportProtocolAPI"] == b"\x00"


def test_a_password_that_was_refused_is_not_tried_again_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench, tried, desk = Bench(password="wrong"), list[str](), Desk._login
    bench.fake.memory.written["BlobTransportProtocolAPI"] = b"\x01"

    def login(self: Desk, name: str, data: bytes, session: Any) -> bytes | int:
        tried.append(name)
        return desk(self, name, data, session)

    monkeypatch.setattr(Desk, "_login", login)
    bench.run(0.9 * LOGIN_S)
    assert tried.count("SetUserLevel") == 1
    bench.run(0.2 * LOGIN_S)
    assert tried.count("SetUserLevel") == 2


def test_the_stream_is_looked_for_where_the_camera_has_it() -> None:
    bench = Bench()
    bench.fake.memory.written["BlobTcpPortAPI"] = (4711).to_bytes(2, "big")
    assert bench.run(1.0)
    assert bench.numbers == [4711]


@pytest.mark.parametrize("model", ["t_mini", "s"])
def test_a_camera_that_streams_by_udp_is_set_to_tcp_or_it_says_why_not(model: Model) -> None:
    bench = Bench(model, password="wrong")
    bench.fake.memory.written["BlobTransportProtocolAPI"] = b"\x01"
    bench.run(1.0)
    told = "the camera streams by UDP, mapod by TCP: the password is wrong"
    assert bench.told == ("starting", told)
    bench = Bench(model)
    bench.fake.memory.written["BlobTransportProtocolAPI"] = b"\x01"
    assert bench.run(1.0)
    assert bench.fake.memory.written["BlobTransportProtocolAPI"] == b"\x00"
    assert not bench.fake.desk.is_occupied


def test_a_stream_that_does_not_open_is_told() -> None:
    bench = Bench()
    bench.stream.connected = False
    bench.run(3.5)
    told = "the camera's stream does not open: the wire in memory is cut"
    assert bench.told == ("starting", told)
    bench.stream.connected = True
    assert bench.run(BACK_S + CONNECT_S)


def test_an_answer_to_another_request_is_a_fault_of_the_stream() -> None:
    bench = Bench()
    bench.wires[0].alter_at = {15: 0x40}  # the first answer's number
    bench.run(0.1)
    assert bench.told[1].startswith("the camera answers Ox with something else")
    assert bench.run(BACK_S)


def test_variants_that_lack_what_is_asked_keep_their_session() -> None:
    nameless = Bench()
    nameless.fake.unknown = "DeviceIdent"
    assert nameless.run(0.8)
    bench = begun()
    for name in ASKED:
        bench.fake.unknown = name
        assert len(bench.run(1.0)) >= 19
    bench.fake.unknown = "deviceState"
    assert len(bench.run(10.0)) >= 199
    assert bench.camera.status.losses == 0


def test_frames_that_come_too_late_are_refused_until_that_is_long_the_usual_way() -> None:
    bench = begun()
    bench.run(1.0)
    bench.fake.latency_s += 0.4
    bench.run(0.1)
    images, causes = 0, set()
    for _ in range(90):
        images += len(bench.run(0.1))
        causes.add(bench.told[1])
    assert any("a frame that comes 0.4 s late" in cause for cause in causes)
    assert images == 0
    bench.run(FORGET_S - 9.0)
    assert bench.run(BACK_S)
    assert bench.told == ("running", "")


def test_the_session_is_kept_and_one_that_has_ended_is_opened_again() -> None:
    bench = begun()
    (number,) = bench.fake.desk.sessions
    bench.run(35.0)
    assert list(bench.fake.desk.sessions) == [number]
    bench.fake.desk.sessions.clear()
    assert len(bench.run(3.0)) >= 59
    assert (len(bench.fake.desk.sessions), bench.camera.status.losses) == (1, 0)
    assert bench.camera.measured()["temperature_c"] == 41.2


def test_the_last_words_stop_the_camera_and_end_the_session() -> None:
    bench = begun()
    bench.camera.stop()
    assert bench.run(0.5) == []
    assert bench.fake.desk.sessions == {}
    assert not bench.fake.is_playing


SILENT: dict[str, tuple[dict[str, Any], str]] = {
    "mute": ({"mute": True}, "the camera does not answer"),
    "mute_stream": ({"mute_stream": True}, "no frame from the camera for 0.5 s"),
    "mute_control": ({"mute_control": True}, "the camera does not answer"),
    "frozen": ({"frozen": True}, SAME_PICTURE),
    "same_number": ({"same_number": True}, SAME_NUMBER),
    "segments": ({"segments": 2}, "a message of 2 segments, not 3"),
    "wrong_length": ({"wrong_length": True}, "a depth set whose lengths differ"),
    "wrong_matrix": ({"wrong_matrix": True}, "a camera matrix that can't be"),
    "turned_matrix": ({"turned_matrix": True}, "a mounting of its own that turns it"),
    "cut": ({"cut_rate": 1.0}, "a message"),
    "wrong_checksum": ({"wrong_checksum": True}, "a frame with a wrong checksum"),
}


@pytest.mark.parametrize("name", list(SILENT))
def test_no_image_is_given_while_it_lasts_the_reason_is_told_and_it_delivers_again(
    name: str,
) -> None:
    faults, reason = SILENT[name]
    bench = begun()
    usual = {fault: getattr(bench.fake, fault) for fault in faults}
    for fault, value in faults.items():
        setattr(bench.fake, fault, value)
    bench.run(0.2)  # frames on their way; a question that was asked before
    causes, images = set(), 0
    for _ in range(40):
        images += len(bench.run(0.1))
        causes.add(bench.told[1])
    assert images == 0 or name in ("mute_control", "wrong_checksum")
    assert any(reason in cause for cause in causes), causes
    assert bench.told[0] == "starting" or name == "wrong_checksum"
    for fault, value in usual.items():
        setattr(bench.fake, fault, value)
    assert bench.run(BACK_S + 1.0)  # the answer that it waits for, 1 s
    assert bench.told == ("running", "")


def test_a_pulled_cable_is_noticed_and_it_delivers_within_a_second_of_its_coming_back() -> None:
    bench = begun()
    bench.pull(is_in=False)
    assert bench.run(2.0) == []
    assert bench.told[0] == "closed"
    bench.pull(is_in=True)
    assert bench.run(BACK_S)
    assert bench.told == ("running", "")


@pytest.mark.parametrize("name", ["control", "stream"])
def test_one_of_both_ports_that_is_lost_is_noticed_and_delivers_again(name: str) -> None:
    bench = begun()
    port = getattr(bench, name)
    port.connected = False
    bench.run(0.1)
    assert bench.run(2.0) == []
    assert bench.told[0] == ("closed" if name == "control" else "starting")
    port.connected = True
    assert bench.run(BACK_S)
    assert bench.told == ("running", "")


def test_a_rebooted_camera_delivers_again_by_its_new_numbers() -> None:
    bench = begun()
    bench.run(3.0)
    bench.fake.reboot(bench.now_s)
    bench.fake.clock_ahead_s = -1.5
    bench.pull(is_in=False)
    bench.run(2.1)
    bench.pull(is_in=True)
    images = bench.run(BACK_S)
    assert images
    assert images[0].counter < 5
    assert bench.camera.status.missed == 0


def test_another_size_in_mid_stream_is_another_camera_record() -> None:
    bench = begun()
    (before, *_) = bench.run(0.1)
    bench.fake.small = True
    after = bench.run(0.5)[-1]
    assert np.array(after.numbers.shape) * 2 == pytest.approx(np.array(before.numbers.shape))
    assert after.camera is not before.camera
    assert bench.told == ("running", "")
    assert bench.camera.status.rejected == 0


def test_a_description_that_changes_under_its_counter_is_not_believed() -> None:
    bench = begun()
    bench.run(0.1)
    bench.fake.changes_silently = bench.fake.small = True
    bench.run(0.1)
    assert bench.run(0.3) == []
    assert "a description that changes, and its counter does not" in bench.reasons
    images = bench.run(BACK_S)  # it has begun anew, and read the description again
    assert images[-1].numbers.shape == (53, 64)


def test_damaged_frames_are_counted_and_not_given() -> None:
    bench = begun()
    before = bench.camera.status.rejected
    bench.fake.damaged_rate = 0.5
    images = bench.run(4.0)
    damaged = bench.camera.status.rejected - before
    assert damaged > 20
    assert 20 < len(images) + damaged <= 81
    assert bench.camera.measured()["wrong_checksums"] > 0
    assert bench.told == ("running", "")


def test_checksums_that_were_never_right_are_counted_alone() -> None:
    bench = Bench()
    bench.fake.wrong_checksum = True
    assert len(bench.run(1.5)) > 20
    assert bench.camera.measured()["wrong_checksums"] > 20
    assert bench.camera.status.rejected == 0


def test_frames_that_the_camera_drops_are_counted() -> None:
    bench = begun()
    bench.fake.skip(7)
    bench.run(0.5)
    assert bench.camera.status.missed == 7
    assert bench.told == ("running", "")


@pytest.mark.parametrize("fault", ["all_invalid", "standby"])
def test_who_sees_nothing_gives_no_image_and_it_is_a_doubt(fault: str) -> None:
    bench = begun()
    setattr(bench.fake, fault, True)
    bench.run(0.1)
    assert bench.run(3.0) == []
    assert bench.told == ("running", "")
    assert bench.camera.doubt == BLIND
    assert bench.camera.is_impaired
    setattr(bench.fake, fault, False)
    assert bench.run(1.0)
    assert bench.run(5.0)
    assert bench.camera.doubt == ""


def test_what_the_camera_says_of_itself_is_told() -> None:
    bench = begun()
    bench.fake.status, bench.fake.warning = 3, 2
    bench.run(5.0)
    assert bench.camera.doubt == "the camera doubts its own images: status 3"
    bench.fake.status = 0
    bench.run(0.5)
    assert bench.camera.doubt == ""
    assert bench.camera.is_impaired


def test_a_calendar_that_is_set_moves_no_instant() -> None:
    bench = begun()
    bench.run(2.0)
    bench.fake.clock_ahead_s = -1.5
    bench.fake.exposed_s.clear()
    images = bench.run(2.0)
    exposed_s = np.array(bench.fake.exposed_s)
    off_s = [np.abs(exposed_s - image.t_s).min() for image in images[2:]]
    assert max(off_s) < 0.005
    assert bench.camera.measured()["clock_settings"] == 1


def test_a_camera_that_refuses_all_is_asked_again_and_says_why() -> None:
    bench = Bench()
    bench.fake.refuse = 0x0D
    bench.run(3.0)
    assert bench.told[0] == "starting"
    assert "the camera refuses PLAYSTOP: it is busy (error D)" in bench.told[1]
    assert len(bench.fake.desk.sessions) <= 1  # each attempt ends its own
    bench.fake.refuse = 0
    assert bench.run(BACK_S)
    assert bench.camera.status.session == State.STREAMING


def test_a_slow_host_gets_the_newest_frame_and_counts_what_it_passed_over() -> None:
    bench = begun()
    for _ in range(60):  # nobody steps the driver for 0.3 s
        for wire in bench.wires:
            wire.step(bench.now_s)
        bench.now_s += 0.005
    images = bench.run(0.008)
    assert len(images) == 1
    assert bench.camera.measured()["frames_passed_over"] == 5
    assert bench.now_s - images[0].t_s < 0.1


FAULTS = st.lists(
    st.tuples(
        st.sampled_from(
            [
                "mute",
                "mute_stream",
                "mute_control",
                "frozen",
                "all_invalid",
                "wrong_matrix",
                "small",
            ]
        ),
        st.integers(1, 30),
    ),
    max_size=4,
)


@pytest.mark.slow
@settings(max_examples=12, deadline=None)
@given(FAULTS)
def test_it_delivers_again_within_its_times_after_any_row_of_faults(
    faults: list[tuple[str, int]],
) -> None:
    bench = Bench()
    for name, tenths in faults:
        setattr(bench.fake, name, True)
        bench.run(tenths / 10)
        setattr(bench.fake, name, False)
    bench.run(max(LEAST_SILENCE_S, LOST_PERIODS * 0.05) + 2.5)
    assert bench.run(0.3)
    assert bench.told == ("running", "")
