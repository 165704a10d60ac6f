"""What a person sees of a replay: a bar, or the map as it was; and the film that is made of it."""

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live

from tools.replay.instants import Timeline
from tools.replay.moment import Moment, moment_of
from tools.replay.playing import Playing
from tools.replay.sources import Source
from tools.terminal.progress import Advance, advancing
from tools.terminal.screen import ROBOT_RADIUS_M, Robot, factor_for, has_screen, map_text

if TYPE_CHECKING:
    from PIL.Image import Image

    from tools.replay.film import Film

FILM_HZ, DRAWN_HZ = 20.0, 20.0  # of a film, of the terminal
BAR_S = 0.5  # of the recording


class Show:
    """What is shown of one replay."""

    def __init__(self, source: Source, speed: float, console: Console) -> None:
        self._source, self._speed, self._console = source, speed, console
        self.maybe_film: Film | None = None
        self.maybe_live: Live | None = None
        self.advance: Advance = lambda done, words: None

    @property
    def pace(self) -> float:
        """Who wants a film waits for nothing."""
        return math.inf if self.maybe_film else self._speed

    @property
    def every_s(self) -> float:
        """How often there is something to look at, by the recording's time."""
        if self.maybe_film:
            return (self._speed if self._speed < math.inf else 1.0) / FILM_HZ
        return self._speed / DRAWN_HZ if self.maybe_live else BAR_S

    def look(self, playing: Playing) -> None:
        if self.maybe_film:
            self.maybe_film.add(picture(self._source, playing))
        if self.maybe_live:
            moment, console = moment_of(playing.replay.app, playing.replay.now_s), self._console
            shape = (moment.states.shape[1], moment.states.shape[0])
            factor = factor_for(shape, console.width - 1, console.height - 2)
            drawn = map_text(moment.states, robot_of(moment), factor)
            self.maybe_live.update(drawn, refresh=True)
        self.tell(playing)

    def tell(self, playing: Playing) -> None:
        """How far it has come."""
        line, now_s = self._source.timeline, playing.replay.now_s
        self.advance(now_s - line.begin_s, line.clock(now_s))


def steps_shown(steps: Iterator[float], what: str, line: Timeline, end_s: float) -> Iterator[float]:
    """The same steps; a bar tells how far they have come."""
    begin_s, told_s = line.begin_s, -math.inf
    with advancing(what, min(end_s, line.end_s) - begin_s) as advance:
        for now_s in steps:
            if now_s - told_s >= BAR_S:
                told_s = now_s
                advance(now_s - begin_s, line.clock(now_s))
            yield now_s


@contextlib.contextmanager
def shown(source: Source, speed: float, film: Path | None, console: Console) -> Iterator[Show]:
    """Raises OSError: the film can't be written."""
    with contextlib.ExitStack() as stack:
        show = Show(source, speed, console)
        if film is not None:
            from tools.replay.film import Film  # its library is an extra

            show.maybe_film = stack.enter_context(contextlib.closing(Film(film, FILM_HZ)))
        elif speed < math.inf and has_screen(console):
            live = Live(console=console, screen=True, auto_refresh=False)
            show.maybe_live = stack.enter_context(live)
        if show.maybe_live is None:
            seconds = source.timeline.end_s - source.timeline.begin_s
            show.advance = stack.enter_context(advancing("replaying", seconds))
        yield show


def robot_of(moment: Moment) -> Robot | None:
    if moment.pose is None:
        return None
    col, row = moment.cell(moment.pose.x_m, moment.pose.y_m)
    return Robot(col, row, moment.pose.yaw_rad, ROBOT_RADIUS_M / moment.cell_m)


def picture(source: Source, playing: Playing) -> "Image":
    from tools.replay.picture import picture_of  # its library is an extra

    now_s, app = playing.replay.now_s, playing.replay.app
    title = f"{source.name}   {source.timeline.clock(now_s)} UTC"
    return picture_of(moment_of(app, now_s), app.config.robot, playing.path, title)
