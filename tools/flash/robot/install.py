"""A bundle becomes a version of its own, and that version the one that runs.

All that can fail is done before the switch, in a folder that nobody looks at: unpacked, compiled,
its settings merged and checked. What a cut leaves there, the next flash removes.
"""

import os
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tools.flash.robot.checks import (
    check_machine,
    check_python,
    check_root,
    check_space,
)
from tools.flash.robot.package import Package
from tools.flash.robot.places import (
    FORM,
    FlashError,
    Places,
    check_form,
    locked,
    move,
    put_file,
    relative,
    sync,
    sync_all,
)
from tools.flash.robot.service import (
    NoService,
    Service,
    State,
    last_line,
    make_user,
    put_recovery,
    put_system_links,
)
from tools.flash.robot.settings import AS_FLASHED, adopt, difference, settings_now
from tools.flash.robot.switch import Tell, finish_cut, switch, why_not

STAGING = ".staging"
COMMAND = """#!{python} -IS
import os
import sys

version = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
sys.path.insert(0, os.path.join(version, "lib"))
from mapod.__main__ import main

sys.exit(main())
"""
FLASH = """#!{python} -IS
"""
TOLD_EACH_S = 10.0


@dataclass(frozen=True)
class Flash:
    """One flash: what, where, how, and who is told."""

    package: Package
    places: Places
    service: Service | NoService
    python: str  # which one the version will run with
    health_s: float
    tell: Tell
    again: bool = False  # also where it runs already

    @property
    def staging(self) -> Path:
        return self.places.versions / f"{STAGING}-{self.package.manifest['id']}"

    @property
    def is_fresh(self) -> bool:
        return not self.places.home.exists()


def install(flash: Flash) -> None:
    """Raises FlashError, OSError: the robot is as it was."""
    places, package = flash.places, flash.package
    check_root(places)
    check_machine(package)
    if flash.service.exists:
        check_python(flash.python)
    check_form(places)
    package.check()
    if flash.is_fresh:
        check_space(places, package)
    with locked(places, f"the flash of {package.name}"):
        finish_cut(places, flash.service, flash.tell)
        remove_unlinked(places)
        if runs_already(places, package) and not flash.again:
            again(flash)
            return
        check_space(places, package)
        name = free_name(places, package.name)
        try:
            prepare(flash, name)
            put_around(flash)
            finish_around(flash)
            switch(places, name, flash.service, flash.health_s, flash.tell)
        except BaseException:
            forget(flash, name)
            raise
        put_command(flash)
        remove_unlinked(places)
        flash.tell(f"{name} is installed{'' if flash.service.exists else '; nothing is started'}")


def runs_already(places: Places, package: Package) -> bool:
    current = places.version(places.current)
    return current is not None and (current + ".").startswith(package.name + ".")


def again(flash: Flash) -> None:
    """The same version once more: whatever an earlier flash that was cut has left undone."""
    finish_around(flash)
    put_command(flash)
    flash.tell(f"{flash.package.name} is installed here already")
    if flash.service.state().is_ready:
        return
    if why := why_not(flash.service, State(), flash.health_s, flash.tell):
        raise FlashError(why)


def prepare(flash: Flash, name: str) -> None:
    """The new version complete under its name, its settings in place."""
    places, staging = flash.places, flash.staging
    places.settings.mkdir(parents=True, exist_ok=True)
    staging.mkdir(parents=True)
    settings = places.settings_of(name)
    unpack(flash, settings)
    compile_python(flash, name)
    merge_settings(flash, settings)
    take_kernels(flash)
    compile_kernels(flash)
    check(flash, settings)
    sync_all(staging)
    move(staging, places.versions / name)


def forget(flash: Flash, name: str) -> None:
    """Takes away what a flash that failed has made, unless it is all that there is."""
    places = flash.places
    if places.version(places.current) != name:
        for folder in (flash.staging, places.versions / name):
            shutil.rmtree(folder, ignore_errors=True)
        places.settings_of(name).unlink(missing_ok=True)


def free_name(places: Places, name: str) -> str:
    """A name that no version and no settings had: nothing is ever overwritten."""
    names = [name, *(f"{name}.{again}" for again in range(2, 1000))]
    return next(
        name
        for name in names
        if not (places.versions / name).exists() and not places.settings_of(name).exists()
    )


def unpack(flash: Flash, settings: Path) -> None:
    staging = flash.staging
    flash.tell("unpacking")
    flash.package.unpack_wheels(staging / "lib", lambda name: None)
    flash.package.unpack_rest(staging)
    (staging / "bin").mkdir()
    command = staging / "bin" / "mapod"
    command.write_text(COMMAND.format(python=flash.python))
    command.chmod(0o755)
    (staging / "mapod.toml").unlink()
    (staging / "mapod.toml").symlink_to(relative(staging / "mapod.toml", settings))


def mapod(flash: Flash, *words: str | Path) -> list[str]:
    """A command of the new version, by the Python that runs this."""
    return [sys.executable, "-IS", str(flash.staging / "bin" / "mapod"), *map(str, words)]


def ran(
    flash: Flash, command: list[str], watch: Callable[[float], None] | None = None
) -> tuple[int, str, str]:
    """Exit status and what it said; it inherits nothing of the environment."""
    env = {"PATH": os.environ.get("PATH", os.defpath), "HOME": "/nonexistent", "LANG": "C.UTF-8"}
    begun_s, state = time.monotonic(), flash.places.root / "var/lib/mapod"
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL,
        text=True, env=env, cwd=state if state.is_dir() else "/",
    ) as process:  # fmt: skip
        try:
            while True:
                try:
                    out, err = process.communicate(timeout=TOLD_EACH_S)
                    return process.returncode, out, err
                except subprocess.TimeoutExpired:
                    if watch:
                        watch(time.monotonic() - begun_s)
        except BaseException:
            process.kill()
            raise


def merge_settings(flash: Flash, settings: Path) -> None:
    """The robot's settings with what is new; the shipped ones where it has none."""
    flash_copy, now = flash.staging / AS_FLASHED, settings_now(flash.places)
    older = ["--from", str(now)] if now else []
    status, out, err = ran(flash, mapod(flash, "init", "--out", flash_copy, *older))
    if status:
        where = f"{now}: " if now else ""
        reason = last_line(err).removeprefix("mapod init: ").removeprefix(where)
        raise FlashError(f"the robot's settings do not fit this version: {reason}")
    new = flash_copy.read_bytes()
    if now is None:
        flash.tell("the robot has no settings: it gets the shipped ones, in /etc/mapod/mapod.toml")
    else:
        for line in [*out.splitlines(), *difference(now.read_bytes(), new, "settings", "new")]:
            flash.tell(f"  {line}")
    put_file(settings, new)


def compile_python(flash: Flash, name: str) -> None:
    """Bytecode, before anything runs. No file's time decides whether it is used."""
    flash.tell("compiling the Python files")
    final = f"/{(flash.places.versions / name).relative_to(flash.places.root)}"
    command = [sys.executable, "-IS", "-m", "compileall", "-q", "-j", "0"]
    command += ["--invalidation-mode", "unchecked-hash", "-s", str(flash.staging), "-p", final]
    status, out, err = ran(flash, [*command, str(flash.staging / "lib")])
    if status:
        raise FlashError(f"can't compile the Python files: {last_line(err or out)}")


def take_kernels(flash: Flash) -> None:
    """Those of the version that runs: a name holds what a kernel is made of, so none is stale."""
    if flash.again:
        return
    old = flash.places.current / "lib"
    for path in old.glob("mapod/**/*.nb[ic]"):
        folder = flash.staging / "lib" / path.parent.relative_to(old)
        if folder.is_dir():
            shutil.copyfile(path, folder / path.name)


def compile_kernels(flash: Flash) -> None:
    """The app's kernels, beside their sources. Raises FlashError: what the compiler said last."""
    flash.tell("compiling the kernels that changed: all of them take half a minute or more")
    lib = flash.staging / "lib"

    def count(seconds: float) -> None:
        flash.tell(f"  {seconds:.0f} s: {sum(1 for _ in lib.rglob('*.nbc'))} kernels compiled")

    warm = mapod(flash, "warm", "--config", flash.staging / AS_FLASHED)
    status, out, err = ran(flash, warm, count)
    if status:
        raise FlashError(f"can't compile the kernels: {last_line(err or out)}")


def check(flash: Flash, settings: Path) -> None:
    """The new version's own look at settings and machine. Raises FlashError: it can't run.

    What `mapod doctor` finds is told and stops nothing: a robot without its scanner is flashed, and
    so is one whose service is down. Of another root's machine it knows nothing.
    """
    status, out, err = ran(flash, mapod(flash, "check", "--config", settings))
    if status:
        raise FlashError(f"mapod check: {last_line(err or out)}")
    if flash.places.root == Path("/") and ran(flash, mapod(flash, "doctor", "--help"))[0] == 0:
        flash.tell("mapod doctor:")
        _, out, err = ran(flash, mapod(flash, "doctor", "--config", settings))
        for line in (out + err).splitlines():
            if line.split(" ")[0] != "OK":
                flash.tell(f"  {line}")


def put_around(flash: Flash) -> None:
    """What lies outside of the version, and leads to whatever is current."""
    places, read = flash.places, flash.package.read
    sysusers = places.root / "etc/sysusers.d/mapod.conf"
    sysusers.parent.mkdir(parents=True, exist_ok=True)
    put_file(sysusers, read("mapod.sysusers"))
    if flash.service.exists:
        make_user(places, sysusers)
    if not places.form.exists():
        put_file(places.form, f"{FORM}\n".encode())
    if places.version(places.current) is None:  # later only by a version that works
        put_recovery(places, read("recover"), read("mapod-recover.service"))


def finish_around(flash: Flash) -> None:
    """Links through `current`, also where an earlier flash was cut before it had put them."""
    for path in put_system_links(flash.places):
        flash.tell(f"{path} is not from a flash: it stays as it is")
    if told := adopt(flash.places):
        flash.tell(told)


def put_command(flash: Flash) -> None:
    """/opt/mapod/flash: status and rollback without a bundle; and what undoes a cut flash."""
    places, package = flash.places, flash.package
    put_recovery(places, package.read("recover"), package.read("mapod-recover.service"))
    new = places.home / ".flash.new"
    with new.open("wb") as file:
        file.write(FLASH.format(python=flash.python).encode())
        with zipfile.ZipFile(file, "w") as small:
            for name in package.code():
                small.writestr(zipfile.ZipInfo(name), package.read(name))
        file.flush()
        os.fsync(file.fileno())
    new.chmod(0o755)
    move(new, places.home / "flash")


def remove_unlinked(places: Places) -> None:
    """Versions that no link names, and what a cut flash has left."""
    kept = {places.version(link) for link in (places.current, places.previous, places.trial)}
    if not places.versions.exists():
        return
    for folder in places.versions.iterdir():
        if folder.name not in kept:
            shutil.rmtree(folder)
    sync(places.versions)
