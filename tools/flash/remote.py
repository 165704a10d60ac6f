"""The way to the robot: ssh, with the user's own configuration, and nothing else.

Three calls: what the robot is (`look`), the bundle (`send`, which goes on where a cut one ended),
and the command there (`run`). No password can be asked for by sudo: the user may do it without, or
is root.
"""

import shlex
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tools.flash.wheels import sha256

PIECE = 1 << 18
UNREACHED = 255  # ssh's own exit status
LOOK = r"""
echo "arch=$(uname -m)"
echo "user=$(id -u)"
if [ "$(id -u)" = 0 ] || sudo -n true 2>/dev/null; then echo "sudo=yes"; else echo "sudo=no"; fi
echo "pythons=$(for v in 11 12 13 14; do
  p=$(command -v python3.$v) && "$p" -c 'import sys; print("%d%d" % sys.version_info[:2])'
done | tr '\n' ' ')"
echo "usual=$(python3 -c 'import sys; print("%d%d" % sys.version_info[:2])' 2>/dev/null)"
echo "free=$(df -Pk /var/tmp | awk 'NR == 2 { print $4 }')"
"""
PREPARE = r"""
umask 077; d=/var/tmp/mapod-flash-$(id -u)
mkdir -p "$d" || exit 1
[ -O "$d" ] && [ ! -L "$d" ] && cd "$d" || { echo "$d is somebody else's" >&2; exit 1; }
for f in *; do case $f in {name}|{name}.part) ;; *) rm -f "$f" ;; esac; done
[ -f {name} ] && echo "whole $(sha256sum < {name})"
[ -f {name}.part ] && echo "part $(wc -c < {name}.part)"
echo "at $d"
"""
TAKE = r"""
cd {folder} || exit 1
dd of={name}.part bs=64k oflag=append conv=notrunc status=none || {{ rm -f {name}.part; exit 1; }}
[ "$(wc -c < {name}.part)" -ge {total} ] || {{ echo "cut off" >&2; exit 1; }}
[ "$(sha256sum < {name}.part)" = "{digest}  -" ] || {{ rm -f {name}.part; echo damaged; exit 0; }}
sync {name}.part; mv -f {name}.part {name}; echo taken
"""
Advance = Callable[[float, str], None]


class RemoteError(Exception):
    """The robot can't be reached, or can't be flashed so; the text says why, in one line."""


@dataclass(frozen=True)
class Machine:
    """What a robot is."""

    arch: str
    is_root: bool
    may_sudo: bool
    pythons: list[str]  # "311": the usual one first
    free_bytes: int


class Robot:
    """One robot, by its ssh name."""

    def __init__(self, host: str, options: list[str]) -> None:
        self.host = host
        self._ssh = ["ssh", "-T", "-o", "ConnectTimeout=10", *options, "--", host]

    def look(self) -> Machine:
        """Raises RemoteError: it does not answer."""
        said = self._asked(LOOK)
        told = dict(line.partition("=")[::2] for line in said.splitlines())
        if "arch" not in told:
            raise RemoteError(f"{self.host} does not answer as a Linux machine")
        usual, pythons = told["usual"], told["pythons"].split()
        return Machine(
            arch=told["arch"],
            is_root=told["user"] == "0",
            may_sudo=told["sudo"] == "yes",
            pythons=sorted(pythons, key=lambda python: (python != usual, python)),
            free_bytes=1024 * int(told["free"] or 0),
        )

    def send(self, path: Path, advance: Advance) -> str:
        """Copies what of a bundle is missing there; gives where it lies. Raises RemoteError."""
        name, digest, total = shlex.quote(path.name), sha256(path), path.stat().st_size
        said = self._asked(PREPARE.replace("{name}", name))
        told = dict(line.partition(" ")[::2] for line in said.splitlines())
        folder, there = told["at"], int(told.get("part", "0"))
        if told.get("whole", "").partition(" ")[0] == digest:
            return f"{folder}/{path.name}"
        take = TAKE.format(folder=shlex.quote(folder), name=name, digest=digest, total=total)
        for start in (there if there <= total else 0, 0):
            if start == 0 and there:
                self._asked(f"rm -f {shlex.quote(folder)}/{name}.part")
            if self._pour(take, path, start, advance) == "taken":
                return f"{folder}/{path.name}"
        raise RemoteError(f"the bundle arrives damaged at {self.host}, twice")

    def run(self, words: list[str], machine_is_root: bool) -> int:
        """A command as root, its words on our standard output. Gives its exit status."""
        command = shlex.join(words if machine_is_root else ["sudo", "-n", *words])
        call = [*self._ssh, command]
        going_on = f"the robot goes on by itself: mapod flash {self.host} --status"
        try:
            status = subprocess.run(call, stdin=subprocess.DEVNULL, check=False).returncode
        except KeyboardInterrupt:
            raise RemoteError(going_on) from None
        if status == UNREACHED:
            raise RemoteError(f"the connection to {self.host} was lost; {going_on}")
        return status

    def _asked(self, script: str) -> str:
        done = subprocess.run(
            [*self._ssh, "sh", "-s"], input=script.encode(), capture_output=True, check=False
        )
        self._check(done.returncode, done.stderr)
        return done.stdout.decode("utf-8", "replace")

    def _pour(self, script: str, path: Path, start: int, advance: Advance) -> str:
        command = [*self._ssh, script]
        with (
            subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            ) as process,
            path.open("rb") as file,
        ):
            assert process.stdin
            file.seek(start)
            done = start
            try:
                while piece := file.read(PIECE):
                    process.stdin.write(piece)
                    done += len(piece)
                    advance(done, "")
            except BrokenPipeError:
                pass
            out, err = process.communicate()
        self._check(process.returncode, err)
        return out.decode().strip()

    def _check(self, status: int, err: bytes) -> None:
        if status:
            lines = err.decode("utf-8", "replace").strip().splitlines() or ["no reason given"]
            where = f"can't reach {self.host}" if status == UNREACHED else self.host
            raise RemoteError(f"{where}: {lines[-1]}")
