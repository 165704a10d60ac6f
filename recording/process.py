"""The writer's process as the app has it: started, heard, and waited for at the end."""

import contextlib
import fcntl
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

PIPE_BYTES = 1 << 20


class WriterProcess:
    """`recording.writer` in a process of its own, which ends when its pipe does."""

    def __init__(self) -> None:
        name = str(__package__)
        root = Path(__file__).parents[name.count(".") + 1]  # where this very package lies
        paths = [str(root), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"{name}.writer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,  # Ctrl-C is the app's alone
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._stdin, self._stdout = self._process.stdin, self._process.stdout
        os.set_blocking(self._stdout.fileno(), False)
        with contextlib.suppress(OSError):  # as much as this user may have stays as it is
            fcntl.fcntl(self.pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        self._said = b""  # of the newest report, not whole yet

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def pipe(self) -> int:
        """The descriptor for what is to be written."""
        return self._stdin.fileno()

    def reports(self) -> list[dict[str, Any]]:
        """What it has said since it was asked last: `event`, `is_well`, and more."""
        try:
            self._said += os.read(self._stdout.fileno(), 1 << 16)
        except OSError:
            return []
        *lines, self._said = self._said.split(b"\n")
        return [json.loads(line) for line in lines]

    def close(self, wait_s: float) -> bool:
        """No more comes. Whether it has ended within that time; else it does so by itself."""
        with contextlib.suppress(OSError):
            self._stdin.close()
        try:
            self._process.wait(max(0.0, wait_s))
        except subprocess.TimeoutExpired:
            return False
        return True

    def let_go(self) -> None:
        """Nothing it says is heard any more."""
        self._stdout.close()
