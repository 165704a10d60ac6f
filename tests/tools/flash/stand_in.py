"""A small app in mapod's place, in real bundles: what is tried is the flash, not the app.

It has the commands that a flash uses. How it fails is written into it when it is built.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

from tools.flash.bundle import write
from tools.flash.wheels import Target

PYTHON = f"{sys.version_info[0]}{sys.version_info[1]}"
APP = """
import os, signal, socket, sys
from pathlib import Path

NUMBER, NEW, STATUS, FAULT = {number}, {new!r}, {status!r}, {fault!r}


def main():
    words = sys.argv[1:]
    config = Path(words[words.index("--config") + 1]) if "--config" in words else None
    if FAULT == words[0]:
        print("as it was built to", file=sys.stderr)
        return 1
    if words[0] == "init":
        return init(Path(words[words.index("--out") + 1]), words)
    if words[0] == "check":
        print("app", NUMBER, "with", config.read_text().split()[0])
        return 0
    if words[0] == "warm":
        Path(__file__).with_name("kernel.nbc").write_bytes(bytes(10))
        if FAULT == "waits":  # until somebody opens its pipe
            os.mkfifo(Path(__file__).with_name("pipe"))
            Path(__file__).with_name("pipe").read_bytes()
        if FAULT == "fills the disk":
            fill(Path(__file__).with_name("big"))
        return 0
    if words[0] == "run":
        return run()
    return 2


def init(out, words):
    text = "a = 1  # shipped\\n"
    if "--from" in words:
        text = Path(words[words.index("--from") + 1]).read_bytes().decode()
        if "unknown" in text:
            print("mapod init: unknown: no such setting", file=sys.stderr)
            return 2
    for line in NEW:
        if line not in text:
            text += line + "\\n"
            print("new setting:", line)
    out.write_bytes(text.encode())
    return 0


def fill(path):
    try:
        with path.open("wb") as file:
            while True:
                file.write(bytes(1 << 16))
                file.flush()
    except OSError:
        pass


def run():
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notify:
        notify.connect(os.environ["NOTIFY_SOCKET"])
        notify.send(f"READY=1\\nSTATUS={{STATUS}}\\n".encode())
    while True:
        signal.pause()
"""


def bundle(
    folder: Path,
    number: int = 1,
    *,
    new: tuple[str, ...] = (),
    status: str = "scanner running; planner told",
    fault: str = "",
    target: Target | None = None,
) -> Path:
    """A bundle with such an app; `fault`: the command that fails, "fills the disk", "waits"."""
    folder.mkdir(parents=True, exist_ok=True)
    wheel = folder / f"mapod-0.{number}-py3-none-any.whl"
    app = APP.format(number=number, new=new, status=status, fault=fault)
    about = f"Metadata-Version: 2.1\nName: mapod\nVersion: 0.{number}\nLicense: none\n"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in (
            ("mapod/__init__.py", ""),
            ("mapod/__main__.py", app),
            ("mapod/tests/test_it.py", ""),
            (f"mapod-0.{number}.dist-info/METADATA", about),
            (f"mapod-0.{number}.dist-info/licenses/LICENSE", "do as you like"),
        ):
            archive.writestr(zipfile.ZipInfo(name), content)
    return write([wheel], target or Target(os.uname().machine, PYTHON), folder)


def flashed(
    bundle: Path, root: Path, *words: str, action: str = "install", path: str = ""
) -> "subprocess.CompletedProcess[str]":
    """Runs a bundle, or /opt/mapod/flash, against a root."""
    command = [sys.executable, "-IS", str(bundle), action, "--root", str(root), *words]
    env = {**os.environ, "PATH": f"{path}:{os.environ['PATH']}"} if path else None
    return subprocess.run(command, capture_output=True, text=True, env=env, check=False)


def runs(root: Path) -> str:
    """What the current version says of itself and its settings: "app 2 with a"."""
    command, config = root / "usr/local/bin/mapod", root / "etc/mapod/mapod.toml"
    words = [str(command), "check", "--config", str(config)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    return done.stdout.strip() or done.stderr.strip()


def tree(root: Path) -> dict[str, str]:
    """Every file and link under a root, with what is in it."""
    return {
        str(path.relative_to(root)): os.readlink(path)
        if path.is_symlink()
        else path.read_bytes().hex()
        for path in sorted(root.rglob("*"))
        if path.name != "lock" and (path.is_symlink() or path.is_file())
    }
