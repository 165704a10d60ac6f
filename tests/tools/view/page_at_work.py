"""The page in a browser, over a script: what its tests share."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from tests.tools.view.scripted_server import TOKEN, Script, Server, served
from tools.docs.browser import Browser

PROBES = (Path(__file__).parent / "probes.js").read_text(encoding="utf-8")
DROVE_S = 13.0  # before a page is opened


@dataclass
class Page:
    """One tab of one script."""

    browser: Browser
    script: Script
    server: Server
    shots: Path

    def open(self, width: int = 1280, height: int = 800, ratio: float = 1.0, **more: bool) -> None:
        touch, token = more.get("touch", False), more.get("token", True)
        url = self.server.url + (f"#token={TOKEN}" if token else "")
        self.browser.open(url, width, height, ratio, touch)

    def probe(self, call: str, *arguments: object) -> Any:
        """What a function of probes.js gives."""
        return self.browser.run(f"{PROBES}\nreturn {call}(...arguments)", *arguments)

    def live(self) -> None:
        self.browser.condition("live")
        self.browser.drawn()

    def click(self, css: str) -> None:
        self.browser.run("document.querySelector(arguments[0]).click()", css)

    def pixel(self, x_m: float, y_m: float) -> str:
        """The colour of the map's canvas at a place."""
        self.browser.drawn()
        return str(self.probe("pixelAt", x_m, y_m))

    def colours(self) -> dict[str, int]:
        """How many pixels of the map's canvas have each colour."""
        self.browser.drawn()
        counts: dict[str, int] = self.probe("countColours")
        return counts

    def colour(self, name: str) -> str:
        """A colour of the style sheet, as it holds now."""
        self.browser.drawn()
        return str(self.browser.run("return mapod.theme.colours[arguments[0]]", name))

    def mouse(self, kind: str, x_m: float, y_m: float, buttons: int = 0) -> None:
        x, y = self.probe("placeInWindow", x_m, y_m)
        button = "left" if kind != "mouseMoved" else "none"
        self.browser.cdp(
            "Input.dispatchMouseEvent",
            type=kind,
            x=x,
            y=y,
            button=button,
            buttons=buttons,
            clickCount=1,
        )

    def heard(self, kind: str) -> int:
        return len(self.script.said(kind))

    def shot(self, name: str) -> None:
        self.browser.shot(self.shots / f"{name}.png")


@cache
def driven() -> Script:
    script = Script()
    script.warm_up(DROVE_S)
    return script


@contextmanager
def a_page(browser: Browser, shots: Path) -> Iterator[Page]:
    """A robot that has driven and stands; not opened yet."""
    script = Script()
    script.drive, script.kept = deepcopy(driven().drive), driven().kept
    script.moves = False
    browser.media(prefers_color_scheme="light", prefers_reduced_motion="no-preference")
    browser.complaints()
    with served(script) as server:
        yield Page(browser, script, server, shots)
        browser.driver.get("about:blank")
    assert script.faults == []
