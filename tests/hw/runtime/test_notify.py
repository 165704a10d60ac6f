"""What systemd hears of the app, over a real socket; and that nothing of it holds the loop up."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from hw.runtime.notify import Notifier
from tests import ROOT

WATCHDOG = {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}


class Systemd:
    """The far end: hears what came, and never waits."""

    def __init__(self, address: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(address.replace("@", "\0"))
        self.socket.setblocking(False)

    def heard(self) -> list[str]:
        messages = []
        while True:
            try:
                messages.append(self.socket.recv(4096).decode())
            except BlockingIOError:
                return messages


@pytest.fixture(params=["/notify", "@mapod/test/"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Systemd, str]]:
    """By a path, and by a name that is no file."""
    kind = str(request.param)
    address = f"{tmp_path}{kind}" if kind[0] == "/" else f"{kind}{os.getpid()}"
    far_end = Systemd(address)
    yield far_end, address
    far_end.socket.close()


def test_the_first_turn_means_ready_and_the_watchdog_is_fed_four_times_a_period(
    systemd: tuple[Systemd, str],
) -> None:
    far_end, address = systemd
    notifier = Notifier({"NOTIFY_SOCKET": address, **WATCHDOG}, lambda now_s: "scanner\nrunning")
    assert far_end.heard() == []
    for tick in range(500):  # 2.495 s of a loop
        notifier.turn_over(tick * 0.005)
    ready, *fed = far_end.heard()
    assert ready.splitlines() == ["READY=1", "WATCHDOG=1", "STATUS=scanner running"]
    assert fed == ["WATCHDOG=1"] * 4
    notifier.stopping()
    assert far_end.heard() == ["STOPPING=1"]
    notifier.close()


def test_a_state_is_told_when_it_changes_also_without_a_watchdog(tmp_path: Path) -> None:
    far_end, states = Systemd(f"{tmp_path}/notify"), iter(["a", "a", "b" * 5000, "a"])
    others = {"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}
    notifier = Notifier({"NOTIFY_SOCKET": f"{tmp_path}/notify", **others}, lambda _: next(states))
    for second in range(4):
        notifier.turn_over(float(second))
    assert far_end.heard() == ["READY=1\nSTATUS=a", f"STATUS={'b' * 1000}", "STATUS=a"]
    notifier.close()
    far_end.socket.close()


def test_what_a_full_socket_does_not_take_is_told_again(tmp_path: Path) -> None:
    path = f"{tmp_path}/notify"
    far_end, other = Systemd(path), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    other.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            other.sendto(b"X=1", path)
    notifier = Notifier({"NOTIFY_SOCKET": path, **WATCHDOG}, lambda now_s: "")
    notifier.turn_over(0.0)
    assert set(far_end.heard()) == {"X=1"}
    notifier.turn_over(0.5)
    assert far_end.heard() == ["READY=1\nWATCHDOG=1"]
    far_end.socket.close()
    notifier.turn_over(1.0)  # nobody is there any more
    notifier.close()
    other.close()


@pytest.mark.parametrize("given", [{}, {"NOTIFY_SOCKET": "notify"}, {"NOTIFY_SOCKET": ""}])
def test_without_a_socket_nothing_is_worked_out(given: dict[str, str]) -> None:
    def described(now_s: float) -> str:
        raise AssertionError("nobody asked")

    notifier = Notifier(given | WATCHDOG, described)
    notifier.turn_over(0.0)
    notifier.stopping()
    notifier.close()


@pytest.mark.real_time
def test_the_app_is_ready_without_any_device_and_says_that_it_ends(tmp_path: Path) -> None:
    shipped = (ROOT / "mapod.toml").read_text(encoding="utf-8")
    settings = tmp_path / "mapod.toml"
    text = shipped.replace("192.168.0.1:2112", "127.0.0.1:1")
    settings.write_text(text.replace('"flight" ', f'"{tmp_path}" '), encoding="utf-8")
    far_end = Systemd(f"{tmp_path}/notify")
    far_end.socket.setblocking(True)
    env = {**os.environ, "NOTIFY_SOCKET": f"{tmp_path}/notify", "WATCHDOG_USEC": "200000"}
    command = [sys.executable, "main.py", "--unattended", "--config", str(settings)]
    with subprocess.Popen(command, cwd=ROOT, env=env, stderr=subprocess.DEVNULL) as app:
        ready = far_end.socket.recv(4096).decode().splitlines()
        heard = [far_end.socket.recv(4096).decode() for _ in range(5)]
        app.send_signal(signal.SIGTERM)
        while heard[-1] != "STOPPING=1":
            heard.append(far_end.socket.recv(4096).decode())
    assert ready[:2] == ["READY=1", "WATCHDOG=1"]
    assert ready[2].startswith("STATUS=scanner closed: ")
    assert all(message.startswith("WATCHDOG=1") for message in heard[:-1])
    assert app.returncode == 0
    far_end.socket.close()
