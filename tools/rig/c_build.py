"""Builds the planner's firmware, and tells where it lies: `python -m tools.rig.c_build`."""

import sys

from core.config import ConfigError
from tools.rig.planner.build import (
    CompileError,
    MissingToolError,
    build_planner_firmware,
    shipped_robot,
)


def main() -> int:
    """Exit status; 2: a tool is missing."""
    try:
        sys.stdout.write(f"{build_planner_firmware(shipped_robot())}\n")
    except (MissingToolError, CompileError, ConfigError) as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
