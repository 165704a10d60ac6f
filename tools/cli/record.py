"""Run the robot as `mapod run` does, and keep every byte of every port in a file.

`mapod replay FILE` plays it. The map of --load-map and the planner's key are not kept in it.
"""

import os
import signal
import sys
import threading
from pathlib import Path

from main import run as run_app
from main import version
from tools.cli.options import add_out, add_seconds, fail, parser_of
from tools.cli.run import add_run_options, arguments_of
from tools.recording import Recorder


def main(arguments: list[str] | None = None) -> int:
    """Exit status: 0 ended as it was told to, 1 recorded in part, 2 wrong use."""
    parser = parser_of("record", __doc__, "mapod record --out hall.rec --seconds 60")
    add_run_options(parser)
    add_seconds(parser, "until Ctrl-C")
    add_out(parser, "the recording", Path("mapod.rec"))
    options = parser.parse_args(arguments)
    try:
        recorder = Recorder(options.out, version(), options.config.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        return fail("record", error)
    if options.seconds:
        end = threading.Timer(options.seconds, os.kill, (os.getpid(), signal.SIGINT))
        end.daemon = True
        recorder.at_start = end.start
    try:
        status = run_app(arguments_of(options), recorder)
    finally:
        recorder.close()
    if recorder.trouble:
        return fail("record", f"{options.out} ends early: {recorder.trouble}", 1)
    size = options.out.stat().st_size
    if status == 0:
        print(f"mapod: {options.out}: {size / 1e6:.1f} MB", file=sys.stderr)
    return status
