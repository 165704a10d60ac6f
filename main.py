"""mapod: laser scanner, attitude and wheel bytes in; obstacle map out on the planner's wire.

Arguments and the loop. The app itself is `App` in app.py.
"""

import argparse
import contextlib
import math
import os
import secrets
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, NamedTuple

from app import App, Ports, warm_kernels
from config_file import load_config, read_key, read_settings, with_changes
from core.config import Config, ConfigError, outdated_in
from core.saved.encoding import Arrays, StateError
from core.saved.state import restore, was_moving
from core.summary import describe_robot
from hw.ports.url import parse_url
from hw.runtime.notify import Notifier
from hw.runtime.threads import take_real_time
from hw.runtime.wakeup import WakeUp
from logs import LOG, set_up_logging
from map_files import NO_CAMERA, MapSaver, ObjectsSaver, load_map, load_objects
from recorder import Recorder, started_recorder
from version import version
from wiring import modbus_servers, open_ports

if TYPE_CHECKING:
    from beside import Beside
    from core.objects.vector_map.geojson import SavedMap

UNATTENDED = "nobody watches this start: robot.start_clear_m counts as 0; goes without --load-map"
RECORD = "record the run: a file that ends with .mcap, or a folder that ends with / ([record] path)"
LOAD_OBJECTS = (
    "go on from a saved map of objects, or begin with a floor plan (GeoJSON); the robot must stand "
    "at its origin and look along its x axis"
)
SETTLE_S = 0.5  # longest wait, after the last tick, for what devices still have to take


class Kept(NamedTuple):
    """What a run goes on from, and the files into which it saves; empty: neither."""

    map: Arrays | None = None
    save_map: str = ""
    objects: "SavedMap | None" = None
    save_objects: str = ""


class Wanted:
    """What signals have asked for: the end, the map in its file, or the last seconds in one."""

    def __init__(self) -> None:
        self.end = self.map = self.flight = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._end)
        if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # nohup: it is to live on
            signal.signal(signal.SIGHUP, self._end)

    def _end(self, number: int, frame: FrameType | None) -> None:
        self.end = True

    def _save(self, number: int, frame: FrameType | None) -> None:
        self.map |= number == signal.SIGUSR1
        self.flight |= number == signal.SIGUSR2

    def over(self, saver: MapSaver | None, recorder: Recorder | None) -> Callable[[], bool]:
        """Listen for what these can save; gives what saves it, and says whether it is the end."""
        for number, listener in ((signal.SIGUSR1, saver), (signal.SIGUSR2, recorder)):
            if listener is not None:
                signal.signal(number, self._save)

        def is_over() -> bool:
            if self.map and saver:
                self.map = False
                saver.save()
            if self.flight and recorder:
                self.flight = False
                recorder.flight(time.monotonic(), "asked", "somebody asked for it")
            return self.end

        return is_over


def slots_missed(late_s: float, period_s: float) -> int:
    """How many slots went by before a turn that came so late.

    One that begins within the first half of its own time is late; behind that it is missed.
    """
    return max(0, math.ceil(late_s / period_s - 0.5))


def keep_pace(app: App, wake_up: WakeUp, is_over: Callable[[], bool], notifier: Notifier) -> None:
    """Let the app take its turns until it is over: when one is due, and as bytes arrive.

    So stamps are true to the instant of reading. Missed slots are counted and never made up.
    """
    period_s, loop = 1.0 / app.config.loop.rate_hz, app.loop
    while not is_over():
        plan, ticks = app.plan, loop.ticks
        due_s = plan.due_s
        readable = wake_up.wait(due_s, plan.ports, plan.hears_s)
        now_s = time.monotonic()
        if now_s >= due_s > -math.inf:
            late_s = now_s - due_s
            loop.late_s.append(late_s)
            if late_s > period_s / 2:
                loop.slots_missed += slots_missed(late_s, period_s)
        app.turn(now_s, readable)
        if loop.ticks != ticks:  # a step: every input was looked at
            notifier.turn_over(now_s)


def settle(app: App, wake_up: WakeUp, notifier: Notifier) -> None:
    """Tell the devices that it ends, and go on until they have taken it, for SETTLE_S at most."""
    app.stop()
    until_s = time.monotonic() + SETTLE_S
    keep_pace(app, wake_up, lambda: app.settled or time.monotonic() >= until_s, notifier)
    if not app.settled:
        LOG.warning("devices_not_settled", waited_s=SETTLE_S)


def maybe_beside(is_needed: bool) -> "Beside[Any] | None":
    """A thread for work beside the loop; none where there is none to do."""
    if not is_needed:
        return None
    from beside import Beside  # for who has a depth camera

    return Beside()


def go_on_from(loaded: Arrays, app: App, recorder: Recorder | None) -> None:
    """Take over a map of the ground."""
    loaded_s = time.monotonic()
    restore(app.mapper, loaded, app.config, loaded_s)
    if recorder:
        recorder.restored(loaded_s)
    LOG.info("map_loaded", moving_when_saved=was_moving(loaded))


def maybe_objects(app: App, frames: "Beside[Any] | None", kept: Kept) -> ObjectsSaver | None:
    """Who looks at frames goes on from a loaded map; gives what saves it at the end."""
    if app.perception is None or app.perception.look is None or frames is None:
        return None
    if kept.objects is not None:
        app.perception.look.start_from(kept.objects, time.monotonic())
        LOG.info("objects_loaded", objects=len(kept.objects.objects), walls=len(kept.objects.walls))
    if not kept.save_objects:
        return None
    return ObjectsSaver(app.perception.look, frames, kept.save_objects)


def serve(
    config: Config,
    ports: Ports,
    key: bytes | None,
    kept: Kept,
    recorder: Recorder | None = None,
    at_start: Callable[[], None] = lambda: None,
) -> None:
    """Run the app until SIGINT, SIGTERM or SIGHUP, from loaded maps on.

    SIGUSR1 saves the map of the ground, SIGUSR2 what the flight recorder has. `at_start` is called
    when all is ready.
    """
    wanted = Wanted()
    warm_kernels(config)
    plans = config.coverage is not None and config.coverage.plan
    frames = maybe_beside(config.has_camera)
    app = App(
        config, ports, session=secrets.randbits(32), key=key, version=version(),
        frames=frames, plans=maybe_beside(plans),
    )  # fmt: skip
    stepped = recorder.begin(app, key is not None, kept.map) if recorder else app
    if kept.map is not None:
        go_on_from(kept.map, app, recorder)
    objects_saver = maybe_objects(app, frames, kept)
    saver = MapSaver(app, kept.save_map) if kept.save_map else None
    is_over = wanted.over(saver, recorder)
    locked, fifo = take_real_time()
    LOG.info("real_time_taken", memory_locked=locked, sched_fifo=fifo)
    LOG.info("app_started", version=version(), planner=config.planner.port)
    servers = modbus_servers(config, app.image)
    app.states.statuses.update(servers.statuses)
    wake_up, notifier = WakeUp(servers), Notifier(os.environ, app.states.describe)

    try:
        at_start()
        keep_pace(stepped, wake_up, is_over, notifier)
        notifier.stopping()
        settle(stepped, wake_up, notifier)
        if saver:
            saver.finish()
        if objects_saver:
            objects_saver.finish()
    finally:
        app.stop()
        servers.close()
        wake_up.close()
        notifier.close()
    LOG.info("app_stopped", ticks=app.loop.ticks, slots_missed=app.loop.slots_missed)


def add_map_options(parser: argparse.ArgumentParser) -> None:
    """Those of files that maps are kept in."""
    add = parser.add_argument
    add(
        "--load-map",
        metavar="FILE",
        help="go on from a saved map; the robot must stand where it stood then",
    )
    add("--save-map", metavar="FILE", help="save the map at the end and on SIGUSR1")
    add("--load-objects", metavar="FILE", help=LOAD_OBJECTS)
    add("--save-objects", metavar="FILE", help="save the map of objects at the end, as GeoJSON")


def options_of(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="main.py", description=__doc__.partition("\n\n")[0])
    add = parser.add_argument
    add("--config", default="mapod.toml", help="settings (default: mapod.toml)")
    add("--check", action="store_true", help="check the settings, tell, and end")
    add("--warm", action="store_true", help="compile the kernels, and end")
    add("--version", action="version", version=f"mapod {version()}")
    add_map_options(parser)
    add("--record", metavar="FILE", help=RECORD)
    add("--unattended", action="store_true", help=UNATTENDED)
    return parser.parse_args(arguments)


def settings_of(options: argparse.Namespace) -> Config:
    """The settings; of a start that nobody watches, no ground is vouched for.

    Raises:
        ConfigError: as load_config.
        StateError: a map is to be loaded, and nobody sees where the robot stands.
    """
    text = read_settings(Path(options.config))
    config = load_config(text)
    for change in outdated_in(text):
        print(f"{options.config}: {change}", file=sys.stderr)
    if options.record:
        config = with_changes(config, record={"path": options.record})
    if not options.unattended:
        return config
    if options.load_map:
        raise StateError(
            "--unattended goes without --load-map: nobody sees whether the robot stands where it "
            "stood when the map was saved"
        )
    return with_changes(config, robot={"start_clear_m": 0.0})


def kept_of(options: argparse.Namespace, config: Config) -> Kept:
    """StateError: a file can't be loaded."""
    return Kept(
        load_map(options.load_map, config) if options.load_map else None,
        options.save_map or "",
        load_objects(options.load_objects, config) if options.load_objects else None,
        options.save_objects or "",
    )


def check_folders(options: argparse.Namespace, config: Config) -> None:
    """StateError where a file that is asked for could not be made."""
    wanted = {
        "--save-map": options.save_map,
        "--save-objects": options.save_objects,
        "record.path": config.record.path,
    }
    if options.save_objects and not config.has_camera:
        raise StateError(f"--save-objects: {NO_CAMERA}")
    for name, path in wanted.items():
        if path and not Path(path).parent.is_dir():
            raise StateError(f"{name}: there is no folder for {path!r}")
        if path and not path.endswith("/") and Path(path).is_dir():
            raise StateError(f"{name}: must be a file, {path!r} is a folder")


def live(
    config: Config,
    ports: Ports,
    key: bytes | None,
    kept: Kept,
    options: argparse.Namespace,
    at_start: Callable[[], None],
) -> str:
    """Run it, logged and recorded; why the recording ended before the run, or ""."""
    with contextlib.ExitStack() as ends:
        ends.enter_context(contextlib.closing(set_up_logging(config, sys.stderr.fileno())))
        if options.unattended:
            LOG.info("start_unattended", start_clear_m=0.0)
        recorder = None
        if config.record.path or config.record.flight:
            recorder = ends.enter_context(contextlib.closing(started_recorder(config, version())))
            ports = recorder.ports(ports)
        serve(config, ports, key, kept, recorder, at_start)
    return recorder.trouble if recorder else ""


def run(
    arguments: list[str] | None = None,
    at_start: Callable[[], None] = lambda: None,
    at_end: Callable[[str], None] = lambda trouble: None,
) -> int:
    """The command line; gives the exit status.

    Args:
        at_start: called when all is ready, before the loop.
        at_end: told why the recording ended before the run, or "".
    """
    options = options_of(arguments)
    for number in (signal.SIGUSR1, signal.SIGUSR2):
        signal.signal(number, signal.SIG_IGN)  # too early, or nothing to save: no end
    try:
        config = settings_of(options)
        key = read_key(config.planner.key_file)
        kept = kept_of(options, config)
        check_folders(options, config)
        ports = open_ports(config)
    except StateError as error:
        print(error, file=sys.stderr)
        return 2
    except (ConfigError, OSError) as error:
        print(f"{options.config}: {error}", file=sys.stderr)
        return 2
    with contextlib.closing(ports):
        if options.check:
            print(describe_robot(config, [parse_url(url).baud for url in config.planner.ports]))
        elif options.warm:
            warm_kernels(config)
        else:
            at_end(live(config, ports, key, kept, options, at_start))
    return 0


if __name__ == "__main__":
    sys.exit(run())
