"""The recipe of the container, as far as it can be tried without a container engine."""

import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests import ROOT

RECIPE = (ROOT / "tools" / "flash" / "Containerfile").read_text(encoding="utf-8")
BUILD = "from setuptools import build_meta; print(build_meta.build_wheel('dist'))"


def built(folder: Path) -> list[str]:
    """The names of the files in the wheel of a tree."""
    done = subprocess.run(
        [sys.executable, "-c", BUILD], cwd=folder, capture_output=True, text=True, check=True
    )
    with zipfile.ZipFile(folder / "dist" / done.stdout.splitlines()[-1]) as archive:
        return sorted(archive.namelist())


@pytest.mark.slow
def test_what_it_copies_is_all_that_the_app_is_built_from(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__", "build", "*.egg-info", ".*", "tests", "docs")
    shutil.copytree(ROOT, tmp_path / "whole", ignore=ignored)
    (tmp_path / "src").mkdir()
    for line in re.findall(r"^COPY (?!--from)(.+ /src/.*)$", RECIPE, re.MULTILINE):
        *sources, target = shlex.split(line)
        for source in sources:
            if (ROOT / source).is_dir():
                shutil.copytree(ROOT / source, f"{tmp_path}{target}", ignore=ignored)
            else:
                shutil.copy(ROOT / source, f"{tmp_path}{target}")
    assert built(tmp_path / "src") == built(tmp_path / "whole")
