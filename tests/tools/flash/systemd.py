"""As much of systemd as a flash sees, where none runs: one unit under a root, and `systemctl`.

It reads the real unit file: runs ExecStartPre and ExecStart, listens to the notify socket, starts
anew what ends. Source: sd_notify(3), systemctl(1).
"""

import json
import os
import re
import shlex
import socket
import subprocess
import sys
import threading
from pathlib import Path

SYSTEMCTL = """#!{python}
import json, socket, sys
with socket.socket(socket.AF_UNIX) as line:
    line.connect({path!r})
    line.sendall(json.dumps(sys.argv[1:]).encode())
    line.shutdown(socket.SHUT_WR)
    status, text = json.loads(b"".join(iter(lambda: line.recv(4096), b"")))
print(text)
sys.exit(status)
"""
STEP_S = 0.05


class Systemd:
    """Runs mapod.service of a root, until it is closed."""

    def __init__(self, root: Path, folder: Path) -> None:
        self.root, self.path = root, folder / "bin"
        self.path.mkdir()
        (root / "run/systemd/system").mkdir(parents=True)
        self._calls = _listening(folder / "calls", socket.SOCK_STREAM)
        self._notes = _listening(folder / "notes", socket.SOCK_DGRAM)
        command = self.path / "systemctl"
        command.write_text(SYSTEMCTL.format(python=sys.executable, path=str(folder / "calls")))
        command.chmod(0o755)
        self.told = {"ActiveState": "inactive", "SubState": "dead", "LoadState": "not-found"}
        self._unit = ""
        self._process: subprocess.Popen[bytes] | None = None
        self._wanted, self._over = threading.Event(), threading.Event()
        self._threads = [threading.Thread(target=of) for of in (self._serve, self._keep)]
        for thread in self._threads:
            thread.start()

    def kill_app(self) -> None:
        if self._process:
            self._process.kill()

    def close(self) -> None:
        self._over.set()
        self._calls.close()
        for thread in self._threads:
            thread.join()
        self.kill_app()
        if self._process:
            self._process.wait()
        self._notes.close()

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                line, _ = self._calls.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            with line:
                words = json.loads(b"".join(iter(lambda: line.recv(4096), b"")))  # noqa: B023
                line.sendall(json.dumps(self._obeyed(words)).encode())

    def _obeyed(self, words: list[str]) -> tuple[int, str]:
        if "daemon-reload" in words:
            unit = self.root / "etc/systemd/system/mapod.service"
            self._unit = unit.read_text() if unit.exists() else ""
            self.told["LoadState"] = "loaded" if self._unit else "not-found"
        if "restart" in words:
            self.told |= {"ActiveState": "deactivating", "SubState": "stop"}
            self._wanted.set()
            self.kill_app()
        return 0, "\n".join(f"{key}={value}" for key, value in self.told.items())

    def _keep(self) -> None:
        """Starts the app when it is wanted and does not run."""
        while not self._over.is_set():
            if self._wanted.is_set() and (not self._process or self._process.poll() is not None):
                self._start()
            try:
                note = dict(
                    part.split("=", 1)
                    for part in self._notes.recv(4096).decode().split("\n")
                    if part
                )
            except TimeoutError:
                continue
            if note.get("READY") == "1":
                self.told |= {"ActiveState": "active", "SubState": "running"}
            self.told["StatusText"] = note.get("STATUS", self.told.get("StatusText", ""))

    def _start(self) -> None:
        self.told |= {"ActiveState": "activating", "SubState": "start", "StatusText": ""}
        for command in self._commands("ExecStartPre"):
            subprocess.run(command, check=False)
        env = {**os.environ, "NOTIFY_SOCKET": self._notes.getsockname()}
        [command] = self._commands("ExecStart")
        self._process = subprocess.Popen(command, env=env, stderr=subprocess.DEVNULL)
        self.told["MainPID"] = str(self._process.pid)

    def _commands(self, key: str) -> list[list[str]]:
        found = re.findall(rf"^{key}=[-+]*(.*)$", self._unit, re.MULTILINE)
        return [
            [
                re.sub(r"^/(opt|etc)/mapod", rf"{self.root}/\1/mapod", word)
                for word in shlex.split(line)
            ]
            for line in found
        ]


def _listening(path: Path, kind: socket.SocketKind) -> socket.socket:
    line = socket.socket(socket.AF_UNIX, kind)
    line.bind(str(path))
    line.settimeout(STEP_S)
    if kind == socket.SOCK_STREAM:
        line.listen()
    return line
