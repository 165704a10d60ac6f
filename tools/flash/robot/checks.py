"""What must hold before anything is changed: each failure is one line."""

import os
import re
import shutil
import sys
from pathlib import Path

from tools.flash.robot.package import Package
from tools.flash.robot.places import FlashError, Places

SPARE_BYTES = 50_000_000  # left free beside what is installed
GROWTH = 1.25  # bytecode and kernels, on top of what the bundle unpacks to


def check_machine(package: Package) -> None:
    """Raises FlashError: another processor, Python or C library than the bundle is for."""
    arch, python = package.manifest["arch"], package.manifest["python"]
    machine = os.uname().machine
    if machine != arch:
        raise FlashError(f"the bundle is for {arch}, this machine is {machine}")
    if sys.maxsize <= 2**32:
        raise FlashError("the bundle is for 64 bits, this Python has 32")
    if sys.implementation.cache_tag != f"cpython-{python[2:]}":
        needed = f"3.{python[3:]}"
        raise FlashError(f"the bundle is for Python {needed}: run it with python{needed}")
    libc = os.confstr("CS_GNU_LIBC_VERSION") if "CS_GNU_LIBC_VERSION" in os.confstr_names else ""
    found = re.search(r"(\d+)\.(\d+)", libc or "")
    needs = package.manifest["libc"]
    if not found or (int(found[1]), int(found[2])) < tuple(map(int, needs.split("."))):
        raise FlashError(f"the bundle needs glibc {needs} or newer, here is {libc or 'another'}")


def check_python(python: str) -> None:
    """Raises FlashError: the service's user can't run it."""
    if python.startswith(("/root/", "/home/")):
        raise FlashError(f"the service can't use {python}: run the bundle with /usr/bin/python3")


def check_root(places: Places) -> None:
    """Raises FlashError: the system can't be written."""
    if not places.root.is_dir():
        raise FlashError(f"there is no folder {places.root}")
    if os.geteuid() != 0 and places.root == Path("/"):
        raise FlashError("needs root: run it with sudo")
    for folder in (places.home, places.etc, places.units, places.root / "usr/local/bin"):
        there = existing(folder)
        if os.statvfs(there).f_flag & os.ST_RDONLY:
            how = "mount it writable first (mount -o remount,rw)"
            raise FlashError(f"{there} is on a read-only file system: {how}")
        if not os.access(there, os.W_OK):
            raise FlashError(f"{there} can't be written: run it with sudo")


def check_space(places: Places, package: Package) -> None:
    """Raises FlashError: too little of it."""
    needs = int(package.manifest["installed_bytes"] * GROWTH) + SPARE_BYTES
    there = existing(places.versions)
    free = shutil.disk_usage(there).free
    if free < needs:
        raise FlashError(
            f"the disk is too full: {there} has {free / 1e6:.0f} MB free, "
            f"the flash needs {needs / 1e6:.0f} MB"
        )


def existing(folder: Path) -> Path:
    """The folder, or the nearest one above it that there is."""
    while not folder.exists():
        folder = folder.parent
    return folder
