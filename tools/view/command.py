"""The page's half of `mapod view`: from its options to a server that runs until it is told."""

import argparse
import asyncio
import errno
import math
import os
import signal
import socket
import sys
from pathlib import Path

from config_file import read_key
from core.config import NO_DRIVE, Config, ConfigError
from mapod_link.wires import wire_from_url
from tools.cli.options import configured, fail
from tools.view.driving import Limits
from tools.view.guard import Guard, TokenError, token_of
from tools.view.link_end import LinkEnd
from tools.view.server import Facts, Server, served
from version import version

OWN_CONFIG = Path("mapod.toml")
UNKNOWN_ROBOT_RADPS = 0.5
MOST_PORT = 65_535
SECOND = (
    "a planner listens there? Give the page a receiver of its own: [planner] port = "
    '["udp://127.0.0.1:9750", "udp://127.0.0.1:9751"], and `mapod view udp://127.0.0.1:9751`'
)


def serve_page(options: argparse.Namespace) -> int:
    """Exit status: 0 ended as it was told to, 1 a port is taken, 2 wrong use."""
    try:
        wanted = options.config or (OWN_CONFIG if OWN_CONFIG.exists() else None)
        config = configured(wanted) if wanted else None
        token = token_of(options.token_file)
        key = read_key(options.key_file)
    except (ConfigError, TokenError) as error:
        return fail("view", error)
    try:
        wire = wire_from_url(options.port)
    except ValueError as error:
        return fail("view", error)
    except OSError as error:
        hint = f"; {SECOND}" if error.errno == errno.EADDRINUSE else ""
        return fail("view", f"{options.port}: {error.strerror or error}{hint}", 1)
    end = LinkEnd(wire, key)
    server = Server(
        end, Guard(options.http[0], token), facts_of(config, options.speed, options.turn)
    )
    try:
        asyncio.run(run_until_told(server, options, token))
    except OSError as error:
        (host, port), why = options.http, os.strerror(error.errno) if error.errno else error
        another = f"give another, such as --http {host}:{port % MOST_PORT + 1}"
        return fail("view", f"--http {host}:{port}: {why}; {another}", 1)
    finally:
        end.close()
    return 0


def facts_of(config: Config | None, speed_mps: float | None, turn_radps: float | None) -> Facts:
    """What the settings say of the robot; without them its size is not known."""
    v_mps, w_radps = speed_mps or math.inf, turn_radps or UNKNOWN_ROBOT_RADPS
    if config is None:
        return Facts(version=version(), limits=Limits(v_mps, w_radps))
    robot = config.robot
    v_mps = min(v_mps, robot.max_speed_mps)
    w_radps = min(turn_radps or math.inf, robot.max_turn_radps)
    refusal = "" if robot.enable_motors else "[robot] enable_motors is false"
    if config.drive.driver == NO_DRIVE:
        refusal = "[drive] driver is none: nothing commands motors"
    size = {"front_m": robot.front_m, "rear_m": robot.rear_m, "width_m": robot.width_m}
    return Facts(version=version(), limits=Limits(v_mps, w_radps, refusal), robot=size)


async def run_until_told(server: Server, options: argparse.Namespace, token: str) -> None:
    """Until a signal, or the end of --seconds. Raises OSError: the port is taken."""
    loop, done = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, done.set)
    host, port = options.http
    async with served(server, host, port) as bound:
        print(address(host, bound, token, options.token_file), flush=True)
        print(f"watching {server.end.url}; Ctrl-C ends", flush=True)
        if options.seconds:
            loop.call_later(options.seconds, done.set)
        await done.wait()


def address(host: str, port: int, token: str, kept: Path | None) -> str:
    """What to open. The token stands behind the #, which no browser sends."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host
    shown = f"http://[{name}]:{port}/" if ":" in name else f"http://{name}:{port}/"
    if kept is not None and not sys.stdout.isatty():  # it may be kept in a log
        return f"{shown}#token=... (it is in {kept})"
    return f"{shown}#token={token}"
