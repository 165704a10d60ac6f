"""A robot's onboard PC: Debian with systemd and sshd, booted in namespaces of its own.

Its disk is a file, on a file system that can copy a file at one instant. Such a copy is what a
power cut leaves on the disk: what programs had written, but the kernel not yet, is not in it.
Needs root. Source: debootstrap(8), systemd-nspawn(1), ioctl_ficlone(2).
"""

import contextlib
import hashlib
import os
import select
import shutil
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from tests import ROOT
from tools.rig.planner.build import MissingToolError

PROGRAMS = {  # and the Debian packages that have them
    "debootstrap": "debootstrap",
    "systemd-nspawn": "systemd-container",
    "mkfs.ext4": "e2fsprogs",
    "mkfs.xfs": "xfsprogs",
    "losetup": "mount",
    "ssh": "openssh-client",
}
SUITE = "bookworm"
PACKAGES = "systemd,systemd-sysv,dbus,openssh-server,python3.11,udev"
CACHE = ROOT / "build" / "second_root"
DISK_BYTES, DISKS_BYTES = 4 * 10**9, 40 * 10**9  # at most; holes take no room
LOOKS, LOOK_S = 3000, 0.02
LOGIN = "root@127.0.0.1"


def ran(*words: str | Path) -> str:
    """What a command says. Raises CalledProcessError."""
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return done.stdout


def until(done: Callable[[], object], what: str, instead: Callable[[], str] = str) -> None:
    """Looks again and again, for a minute at least. `instead` says what there is in place of it."""
    for _ in range(LOOKS):
        if done():
            return
        select.select([], [], [], LOOK_S)
    raise AssertionError(f"it did not come about: {what}\n{instead()}")


def why_not() -> str:
    """Why no second root can be booted here; "" where one can. Raises MissingToolError."""
    if os.geteuid() != 0:
        return "a second root needs root"
    for name, package in PROGRAMS.items():
        if shutil.which(name) is None:
            raise MissingToolError(f"needs {name}: apt install {package}")
    tried = ["unshare", "--mount", "--pid", "--ipc", "--uts", "--fork", "true"]
    if subprocess.run(tried, capture_output=True, check=False).returncode:
        return "this machine permits no namespaces"
    if subprocess.run(["losetup", "--find"], capture_output=True, check=False).returncode:
        return "this machine has no loop devices"
    return ""


def base_image() -> Path:
    """The disk of a fresh Debian, made once for this checkout. Raises MissingToolError."""
    name = hashlib.sha256(f"{SUITE} {PACKAGES} {DISK_BYTES}".encode()).hexdigest()[:10]
    image = CACHE / f"{SUITE}-{name}.ext4"
    if image.exists():
        return image
    tree, part = CACHE / "tree", CACHE / "part.ext4"
    shutil.rmtree(tree, ignore_errors=True)
    part.unlink(missing_ok=True)
    CACHE.mkdir(parents=True, exist_ok=True)
    try:
        ran("debootstrap", "--variant=minbase", f"--include={PACKAGES}", SUITE, tree)
    except subprocess.CalledProcessError as error:
        said = (error.stdout + error.stderr).splitlines()[-1:]
        raise MissingToolError(f"needs a mirror of Debian, for debootstrap: {said}") from None
    shutil.rmtree(tree / "var/cache/apt")
    ran("truncate", f"--size={DISK_BYTES}", part)
    ran("mkfs.ext4", "-q", "-d", tree, part)
    shutil.rmtree(tree)
    return part.rename(image)


@contextlib.contextmanager
def disks(folder: Path) -> Iterator[Path]:
    """A folder where files are copied at an instant, until the block ends.

    It is shared: what is unmounted in it is so for other programs' namespaces as well, and no disk
    that is out stays in use there.
    """
    backing, mounted = folder / "disks.xfs", folder / "disks"
    mounted.mkdir()
    ran("truncate", f"--size={DISKS_BYTES}", backing)
    ran("mkfs.xfs", "-q", "-m", "reflink=1", backing)
    ran("mount", "-o", "loop", backing, mounted)
    ran("mount", "--make-shared", mounted)
    try:
        yield mounted
    finally:
        ran("umount", mounted)
        backing.unlink()


def copied(disk: Path, name: str) -> Path:
    """What is on a disk at this instant, as a disk of its own."""
    copy = disk.with_name(name)
    ran("cp", "--reflink=always", disk, copy)
    return copy


class SecondRoot:
    """One such PC. Its network is the host's loopback: sshd listens on a port of its own there.

    `disk` is its disk; it may be changed for another one while it is off.
    """

    def __init__(self, disk: Path, folder: Path) -> None:
        self.disk, self.port = disk, free_port()
        self.identity, self._mounted = folder / "identity", disk.parent / "root"
        self._process: subprocess.Popen[bytes] | None = None
        self._mounted.mkdir()
        ran("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", self.identity)
        with self.opened() as root:
            keys = root / "root/.ssh/authorized_keys"
            keys.parent.mkdir(mode=0o700, exist_ok=True)
            keys.write_bytes(self.identity.with_suffix(".pub").read_bytes())
            sshd = f"Port {self.port}\nListenAddress 127.0.0.1\n"
            (root / "etc/ssh/sshd_config.d/port.conf").write_text(sshd)
            (root / "etc/hosts").write_text("127.0.0.1 localhost\n")

    @contextlib.contextmanager
    def opened(self) -> Iterator[Path]:
        """Its files, while it is off."""
        ran("mount", "-o", "loop", self.disk, self._mounted)
        try:
            yield self._mounted
        finally:
            ran("umount", self._mounted)

    @property
    def options(self) -> dict[str, str]:
        """Of ssh: every cut disk has the same key, which nobody else trusts."""
        return {
            "StrictHostKeyChecking": "no",
            "UserKnownHostsFile": "/dev/null",
            "LogLevel": "ERROR",
        }

    def boot(self) -> None:
        """On, until somebody can log in."""
        ran("mount", "-o", "loop", self.disk, self._mounted)
        words = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit", "--boot"]
        self._process = subprocess.Popen(
            [*words, f"--directory={self._mounted}"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        until(lambda: self.asked("true").returncode == 0, "a login over ssh")

    def asked(self, command: str) -> "subprocess.CompletedProcess[str]":
        """A command there, over ssh."""
        given = [word for pair in self.options.items() for word in ("-o", "=".join(pair))]
        ssh = ["ssh", "-T", "-p", str(self.port), "-i", str(self.identity), *given, LOGIN, command]
        return subprocess.run(
            ssh, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
        )

    def said(self, command: str) -> str:
        """What a command there says."""
        done = self.asked(command)
        assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
        return done.stdout.strip()

    def cut(self) -> None:
        """The power is off: the disk has what was on it at this instant, and is off."""
        left = copied(self.disk, f"{self.disk.name}.left")
        self.close()
        left.replace(self.disk)

    def close(self) -> None:
        """All its processes are killed, and its disk is taken out."""
        if self._process is None:
            return
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        for child in children.read_text().split():  # its first process: the others end with it
            os.kill(int(child), signal.SIGKILL)
        self._process.wait()
        self._process = None
        ran("umount", self._mounted)


def free_port(kind: int = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])
