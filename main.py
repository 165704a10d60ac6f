"""mapod: laser scanner, attitude and wheel bytes in; obstacle map out on the planner's wire.

Arguments, logging, opening the ports, the loop, shutdown. The app itself is `App` in app.py.
"""

import argparse
import asyncio
import contextlib
import logging
import math
import os
import secrets
import signal
import sys
import time
import tomllib
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Protocol

import structlog

from app import App, Ports, warm_kernels
from core.config import Config, ConfigError, key_from_bytes, load_config
from core.saved.check import check_state
from core.saved.encoding import Arrays, StateError, arrays_from_bytes, bytes_from_arrays
from core.saved.state import restore, state_of, was_moving
from core.summary import robot_in_words
from hw.device import Port
from hw.modbus.server import ModbusServer
from hw.ports.wires import PortUrlError, open_port, parse_url
from hw.runtime.real_time import leave_real_time, take_real_time
from hw.runtime.timer import Timer
from hw.runtime.wakeup import WakeUp

__all__ = ["App", "Ports"]


def read_key(path: str) -> bytes | None:
    """The planner link's key: 32 bytes, or 64 hex digits; None for "".

    Raises:
        ConfigError: the file can't be read, or holds no key.
    """
    if not path:
        return None
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"planner.key_file: can't read {path!r}: {error.strerror}") from None
    return key_from_bytes(content, path)


def check_ports(config: Config) -> None:
    """What the URLs of all ports say, before any of them opens.

    Raises:
        ConfigError: a URL that names no port, one for two, seven bits where all eight are needed.
    """
    given = [(name, getattr(config, name).port) for name in ("scanner", "ahrs", "drive")]
    given += [("planner", url) for url in config.planner.ports]
    given += [("modbus", url) for url in config.modbus.ports]
    lines: dict[str, str] = {}  # by the path of a serial line: whose it is
    for section, url in given:
        try:
            parts = parse_url(url)
        except PortUrlError as error:
            raise ConfigError(f"{section}.port: {error}") from None
        if parts.kind != "serial":
            continue
        if parts.bytesize != 8 and section in ("planner", "modbus"):
            raise ConfigError(f"{section}.port: bytesize must be 8 here, is 7 in {url!r}")
        if parts.path in lines:
            raise ConfigError(f"{section}.port: {url!r} is {lines[parts.path]}.port already")
        lines[parts.path] = section


class Recorder(Protocol):
    """Writes a run down: gives for each port, and for the app, what is used in its place."""

    def port(self, name: str, port: Port) -> Port:
        """The same port, which tells of its bytes."""

    def app(self, app: App) -> App:
        """The same app, which tells of its steps."""


def open_ports(config: Config, recorder: Recorder | None = None) -> Ports:
    """The ports of devices and planners, none of them connected yet.

    Raises:
        ConfigError: as check_ports; a host without an address.
    """

    check_ports(config)

    def opened(section: str, url: str) -> Port:
        try:
            port = open_port(url)
        except PortUrlError as error:
            raise ConfigError(f"{section}.port: {error}") from None
        return recorder.port(section, port) if recorder else port

    return Ports(
        opened("scanner", config.scanner.port),
        opened("ahrs", config.ahrs.port),
        opened("drive", config.drive.port),
        opened("planner", config.planner.ports[0]),
        tuple(opened("planner", url) for url in config.planner.ports[1:]),
    )


def set_up_logging(config: Config) -> None:
    """structlog to stderr, for a person or as JSON lines."""
    renderer = (
        structlog.processors.JSONRenderer()
        if config.log.format == "json"
        else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(
            logging.getLevelNamesMapping()[config.log.level.upper()]
        ),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )


def load_map(path: str, config: Config) -> Arrays:
    """The state of a map in a file, fit to go on from with these settings.

    Raises:
        StateError: the file can't be read, was damaged, or belongs to other settings.
    """
    try:
        arrays = arrays_from_bytes(Path(path).read_bytes())
        check_state(arrays, config)
    except (OSError, StateError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise StateError(f"can't load the map {path!r}: {reason}") from None
    return arrays


def write_map(path: str, arrays: Arrays) -> None:
    """A state into a file, whole or not at all: what was there before stays until then.

    Raises:
        OSError: it can't be written.
    """
    part = Path(f"{path}.part")
    with part.open("wb") as file:
        file.write(bytes_from_arrays(arrays))
        file.flush()
        os.fsync(file.fileno())
    part.replace(path)


class MapSaver:
    """Saves an app's map into a file, beside the loop; where it can't, the log says why."""

    def __init__(self, app: App, path: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._app, self._path, self._clock = app, path, clock
        self._log = structlog.get_logger()
        self._writing: asyncio.Future[None] | None = None

    def save(self) -> None:
        """Save the map as it is now; the file is written meanwhile."""
        if self._writing is not None and not self._writing.done():
            self._log.warning("map_not_saved", reason="the one before is still being written")
            return
        try:
            arrays = state_of(self._app.mapper, self._app.config, self._clock())
        except StateError as error:
            self._log.warning("map_not_saved", reason=str(error))
            return
        loop = asyncio.get_running_loop()
        self._writing = loop.run_in_executor(None, self._write, arrays)

    def _write(self, arrays: Arrays) -> None:
        leave_real_time()
        try:
            write_map(self._path, arrays)
        except OSError as error:
            self._log.warning("map_not_saved", reason=str(error))
        else:
            self._log.info("map_saved", file=self._path, moving=was_moving(arrays))

    async def finish(self) -> None:
        """Save for the last time; all is written afterwards."""
        if self._writing is not None:
            await self._writing
        self.save()
        if self._writing is not None:
            await self._writing


def slots_until_next(since_due_s: float, period_s: float) -> int:
    """How many slots after one that was due so long ago the next one lies that can be begun.

    One that begins within the first half of its own time is late; behind that it is missed.
    """
    return max(1, math.ceil(since_due_s / period_s - 0.5))


async def keep_pace(app: App, period_s: float, stop: asyncio.Event) -> None:
    """Step the app at a fixed rate until told to stop; missed slots are skipped and counted.

    Between ticks it hears what arrives, so that stamps are true to the instant of reading.
    """
    due_s, ports = time.monotonic(), app.ports
    timer = Timer(asyncio.get_running_loop())
    wake_up = WakeUp(
        asyncio.get_running_loop(),
        (ports.scanner, ports.ahrs, ports.drive),
        lambda: app.hear(time.monotonic()),
    )
    while not stop.is_set():
        await timer.wait_until(due_s)
        app.note_tick(time.monotonic() - due_s)
        app.step(time.monotonic())
        wake_up.after_tick()
        now_s = time.monotonic()
        slots = slots_until_next(now_s - due_s, period_s)
        if slots > 1:
            app.note_missed(now_s, slots - 1)
        due_s += period_s * slots
    wake_up.close()
    timer.close()


async def serve(
    config: Config,
    ports: Ports,
    key: bytes | None,
    loaded: Arrays | None,
    save_to: str,
    recorder: Recorder | None = None,
) -> None:
    """Run the app until SIGINT or SIGTERM, from a loaded map on; SIGUSR1 saves the map."""
    log = structlog.get_logger()
    stop = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    warm_kernels(config)
    app = App(config, ports, session=secrets.randbits(32), key=key, version=version())
    if loaded is not None:
        restore(app.mapper, loaded, config, time.monotonic())
        log.info("map_loaded", moving_when_saved=was_moving(loaded))
    saver = MapSaver(app, save_to) if save_to else None
    if saver:
        asyncio.get_running_loop().add_signal_handler(signal.SIGUSR1, saver.save)
    locked, fifo = take_real_time()
    log.info("real_time_taken", memory_locked=locked, sched_fifo=fifo)
    log.info("app_started", version=version(), planner=config.planner.port)
    servers = modbus_servers(app)
    try:
        stepped = recorder.app(app) if recorder else app
        await keep_pace(stepped, 1.0 / config.loop.rate_hz, stop)
    finally:
        app.stop()
        for server in servers:
            await server.stop()
    if saver:
        await saver.finish()
    log.info("app_stopped", ticks=app.ticks, slots_missed=app.slots_missed)


def modbus_servers(app: App) -> list[ModbusServer]:
    """A server, started, for each port of [modbus]; what becomes of it is in the app's log."""
    servers = []
    for url in app.config.modbus.ports:
        assert app.image is not None
        servers.append(
            ModbusServer(
                url, app.image, time.monotonic, unit=app.config.modbus.unit, utc_s=time.time
            )
        )
        app.servers[f"modbus {url}"] = servers[-1].status
        servers[-1].start()
    return servers


def version() -> str:
    """The version in pyproject.toml: of the checkout, or as installed from it."""
    path = Path(__file__).parent / "pyproject.toml"
    if not path.exists():
        return metadata.version("mapod")
    return str(tomllib.loads(path.read_text(encoding="utf-8"))["project"]["version"])


def run(arguments: list[str] | None = None, recorder: Recorder | None = None) -> int:
    """The command line; gives the exit status. `recorder` writes a live run down."""
    parser = argparse.ArgumentParser(prog="main.py", description=__doc__.partition("\n\n")[0])
    parser.add_argument("--config", default="mapod.toml", help="settings (default: mapod.toml)")
    parser.add_argument("--check", action="store_true", help="check the settings, tell, and end")
    parser.add_argument("--warm", action="store_true", help="compile the kernels, and end")
    parser.add_argument("--version", action="version", version=f"mapod {version()}")
    parser.add_argument(
        "--load-map",
        metavar="FILE",
        help="go on from a saved map; the robot must stand where it stood then",
    )
    parser.add_argument("--save-map", metavar="FILE", help="save the map at the end and on SIGUSR1")
    options = parser.parse_args(arguments)
    signal.signal(signal.SIGUSR1, signal.SIG_IGN)  # too early, or without --save-map: no end
    try:
        config = load_config(Path(options.config).read_text(encoding="utf-8"))
        key = read_key(config.planner.key_file)
        loaded = load_map(options.load_map, config) if options.load_map else None
        if options.save_map and not Path(options.save_map).parent.is_dir():
            raise StateError(f"--save-map: there is no folder for {options.save_map!r}")
        ports = open_ports(config, recorder)
    except StateError as error:
        print(error, file=sys.stderr)
        return 2
    except (ConfigError, OSError, UnicodeDecodeError) as error:
        print(f"{options.config}: {error}", file=sys.stderr)
        return 2
    with contextlib.closing(ports):
        if options.check:
            print(robot_in_words(config, [parse_url(url).baud for url in config.planner.ports]))
        elif options.warm:
            warm_kernels(config)
        else:
            set_up_logging(config)
            asyncio.run(serve(config, ports, key, loaded, options.save_map, recorder))
    return 0


if __name__ == "__main__":
    sys.exit(run())
