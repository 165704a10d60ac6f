"""From one version to another, so that a cut at any moment leaves one that works.

Order, each step on the disk before the next: the new version's folder and settings; `trial` names
the old version; `current` names the new one; restart; health. Then `trial` becomes `previous` (the
new one stays) or `current` (it does not), in one rename. Until then whoever finds `trial` without a
flash at work, at the next start or in the next flash, goes back: see `recover`.
"""

from collections.abc import Callable

from tools.flash.robot.places import FlashError, Places, move, put_link
from tools.flash.robot.service import NoService, Service, State
from tools.flash.robot.settings import is_ours, ours

Tell = Callable[[str], None]


def switch(
    places: Places, name: str, service: Service | NoService, health_s: float, tell: Tell
) -> None:
    """Makes a version current. Raises FlashError: it does not work, and the old one is back."""
    before, old = service.state(), places.version(places.current)
    if old is not None:
        put_link(places.trial, f"versions/{old}")
    why = ""
    try:
        put_link(places.current, f"versions/{name}")
        if not is_ours(places):  # first flash: what stood there is in its settings
            put_link(places.toml, ours(places))
        why = why_not(service, before, health_s, tell)
    except BaseException:
        _go_back(places, service, old, "the flash was broken off", tell)
        raise
    if why:
        _go_back(places, service, old, why, tell)
        if service.exists and old is not None:
            tell_of_the_old(service, before, health_s, tell)
        raise FlashError(f"{name} does not work: {why}" + ("; went back to " + old if old else ""))
    if old is not None:
        move(places.trial, places.previous)


def why_not(service: Service | NoService, before: State, health_s: float, tell: Tell) -> str:
    """Restarts the service; gives why it does not work then, or ""."""
    if not service.exists:
        return ""
    tell(f"restarting the service; it has {health_s:g} s to be well")
    try:
        service.restart()
    except FlashError as error:
        return str(error)
    why = service.wait_until_healthy(before, health_s)
    if not why:
        tell(f"the service is {service.state().describe()}")
    return why


def _go_back(
    places: Places, service: Service | NoService, old: str | None, why: str, tell: Tell
) -> None:
    for line in service.last_words():
        tell(f"  | {line}")
    tell(why)
    if old is None:
        tell("there is no earlier version to go back to: it stays")
        return
    move(places.trial, places.current)
    tell(f"going back to {old}")
    restart(service, tell)


def tell_of_the_old(
    service: Service | NoService, before: State, health_s: float, tell: Tell
) -> None:
    worse = service.wait_until_healthy(before, health_s)
    tell(f"it does not work as before: {worse}" if worse else "it works as before")


def restart(service: Service | NoService, tell: Tell) -> None:
    if service.exists:
        try:
            service.restart()
        except FlashError as error:
            tell(str(error))


def finish_cut(places: Places, service: Service | NoService, tell: Tell) -> None:
    """Goes back where an earlier flash was cut while its version was on trial."""
    if not places.trial.is_symlink():
        return
    move(places.trial, places.current)
    tell(f"an earlier flash was cut: back to {places.version(places.current)}")
    restart(service, tell)
