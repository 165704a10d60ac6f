"""The page of `mapod view` in headless Chromium: what it shows, and that it never shows too much.

The pictures it takes lie in pytest's temporary folder (`shots`).
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.tools.view.made_up import DITCH
from tests.tools.view.page_at_work import PROBES, Page, a_page
from tests.tools.view.scripted_server import TOKEN
from tools.docs.browser import CHROMIUM, DRIVER, Browser, a_browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="needs a browser: apt install chromium chromium-driver"
    ),
]
IN_DITCH = (9.6, 1.2)
ON_FLOOR = (7.0, -1.0)
NEVER_SEEN = (2.0, 5.0)
STALE = {
    "link": {"text": "STALE: poses or maps do not arrive in time", "stale": True, "age_s": 2.1}
}
FAULT = {
    "mode": 3, "mode_name": "fault", "health_bits": 0b101_1110, "advice": ["stop", "mode 3"],
    "inputs": [{"name": "scanner", "ok": False, "age_s": None, "text": "connection refused"}],
}  # fmt: skip
NO_MAP = {"health_bits": 0b101_1111}
BOX = {"id": 3, "kind": "static", "v": [0.0, 0.0],
       "outline": [6.0, -1.2, 6.6, -1.2, 6.6, -0.6, 6.0, -0.6]}  # fmt: skip
WALKER = {"id": 258, "kind": "moving", "v": [0.0, -0.5],
          "outline": [7.5, 0.8, 8.0, 0.8, 8.0, 1.3, 7.5, 1.3]}  # fmt: skip
IN_BOX, IN_WALKER = (6.3, -0.9), (7.65, 1.15)
ALL_DRAWN = {"state": "known", "why": ""}


def vectors(*objects: dict[str, object], **more: object) -> list[dict[str, Any]]:
    ahead = {"type": "path", "points": [5.4, 0.4, 7.0, 0.4, 9.2, 0.4], "kinds": [1, 1, 1]}
    told = {"type": "objects", "objects": list(objects)}
    return [{**ALL_DRAWN, **message, **more} for message in (told, ahead)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with a_browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("shots")


@pytest.fixture
def page(browser: Browser, shots: Path) -> Iterator[Page]:
    with a_page(browser, shots) as at_work:
        yield at_work


@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.slow)])
def test_cells_have_the_colours_of_what_they_are(page: Page, theme: str) -> None:
    page.browser.media(prefers_color_scheme=theme)
    page.open()
    page.live()
    page.shot(theme)
    page.browser.run("for (const box of document.querySelectorAll('[data-show]')) box.click()")
    assert page.pixel(*IN_DITCH) == page.colour("obstacle")
    assert page.pixel(*ON_FLOOR) == page.colour("free")
    assert page.pixel(*NEVER_SEEN) in (page.colour("unknown"), page.colour("hatch"))
    assert page.browser.run("return document.documentElement.dataset.theme") == theme
    assert page.browser.text("#condition") == "Live"
    assert "m² free" in page.browser.run("return document.getElementById('map-words').textContent")
    assert page.browser.complaints() == []


@pytest.mark.parametrize(
    ("key", "over", "said"),
    [
        ("stale", STALE, "Poses or maps do not arrive in time. What is shown is 2.1 s old."),
        ("fault", FAULT, "Scanner: connection refused."),
        ("untrusted", NO_MAP, "mapod does not trust it now."),
        ("silent", None, "Nothing heard for"),
    ],
)
def test_what_is_not_current_has_no_colour_of_free(
    page: Page, key: str, over: dict[str, object] | None, said: str
) -> None:
    page.open()
    page.live()
    assert page.colours()[page.colour("free")] > 10_000
    page.script.over, page.script.speaks = over or {}, over is not None
    page.browser.condition(key)
    page.shot(key)
    colours = page.colours()
    assert not {page.colour("free"), page.colour("obstacle")} & colours.keys()
    assert colours[page.colour("stale_free")] > 10_000
    assert said in page.browser.text("#banner")
    assert page.browser.text("#advice strong") == "STOP"
    page.click("#arm")
    page.browser.wait("document.getElementById('who').innerText.includes('not current')")
    page.browser.key("keyDown", "ShiftLeft", "Shift")
    page.browser.key("keyDown", "KeyW", "W")
    page.script.over, page.script.speaks = {}, True
    page.live()
    page.browser.wait(lambda: page.heard("drive"))  # held on: it drives as soon as it may
    page.browser.run("dispatchEvent(new Event('blur'))")


def test_objects_and_the_path_are_drawn_and_go_when_they_are_gone_or_stale(page: Page) -> None:
    page.script.vectors = vectors(BOX, WALKER)
    page.open()
    page.live()
    page.browser.wait("mapod.live.objects?.objects.length === 2 && mapod.live.path !== null")
    page.shot("objects")
    floor = page.colour("free")
    assert floor not in (page.pixel(*IN_BOX), page.pixel(*IN_WALKER))
    assert page.pixel(*IN_BOX) != page.pixel(*IN_WALKER)  # the one that moves is far fuller
    colours = page.colours()
    assert min(colours[page.colour("object")], colours[page.colour("ahead")]) > 100
    assert page.browser.text("#objects-words") == "2, 1 moving"
    page.script.over = STALE
    page.browser.condition("stale")
    assert not {page.colour("object"), page.colour("ahead")} & page.colours().keys()
    assert page.browser.text("#objects-words") == "not current"
    page.script.over, page.script.vectors = (
        {},
        vectors(BOX, state="suspect", why="a frame is missing"),
    )
    page.live()
    page.browser.wait("mapod.live.objects.objects.length === 1")
    assert page.pixel(*IN_WALKER) == floor
    assert page.pixel(*IN_BOX) != floor  # paler: it may be gone
    assert "1; not sure: a frame is missing" in page.browser.text("#objects-words")
    page.click("[data-show=objects]")
    assert page.pixel(*IN_BOX) == floor
    page.click("[data-show=objects]")
    page.script.vectors = vectors(state="none")
    page.browser.wait("mapod.live.objects.objects.length === 0")
    assert page.pixel(*IN_BOX) == floor
    assert page.browser.complaints() == []


@pytest.mark.slow
def test_a_server_that_goes_and_comes_is_found_again(page: Page) -> None:
    page.open()
    page.live()
    page.server.hang_up()
    page.browser.condition("lost")
    page.browser.wait("document.getElementById('banner').innerText.includes('Next try in')")
    assert page.colour("free") not in page.colours()
    page.shot("lost")
    page.server.listen_again()
    page.click("#banner button")
    page.live()
    assert page.pixel(*IN_DITCH) == page.colour("obstacle")


@pytest.mark.slow
def test_the_past_is_very_visible_and_can_be_stepped_through(page: Page) -> None:
    page.open()
    page.live()
    page.browser.wait("mapod.timeline.kept_s !== null")  # the server has kept what was before
    page.click("#pause")
    page.browser.wait("document.documentElement.dataset.past === 'true'")
    page.browser.wait("document.getElementById('moment').min < -9")
    page.probe("setSlider", "#moment", -9)
    page.browser.wait("mapod.shown.window !== null")
    page.browser.drawn()
    page.shot("paused")
    assert "What you see is 9." in page.browser.text("#banner")
    assert page.browser.text("#condition") == "Paused"
    then_m, now_m = page.browser.run("return [mapod.shown.state.pose.x, mapod.live.state.pose.x]")
    assert 2.0 < now_m - then_m < 5.0
    page.click("#back")
    page.browser.wait(f"mapod.shown.state?.pose.x < {then_m}")
    page.click("#live")
    page.click("#back")  # of what the page has seen itself
    ago_s = page.browser.run("return mapod.live.t_s - mapod.shown.state.t_s")
    page.click("#back")
    assert page.browser.run("return mapod.live.t_s - mapod.shown.state.t_s") > ago_s
    page.click("#arm")  # nobody drives by a picture of the past
    page.browser.wait("document.documentElement.dataset.past === 'false'")
    assert page.browser.run("return mapod.shown === mapod.live")


def test_a_cell_tells_what_and_why_and_stays_when_pinned(page: Page) -> None:
    page.open()
    page.live()
    page.mouse("mouseMoved", *IN_DITCH)
    page.browser.wait("document.getElementById('cell-why').innerText.includes('never showed')")
    told = page.browser.text("#readout dl")
    assert "obstacle" in told
    assert f"{DITCH[4]:.3f}".replace("-", "−") in told
    page.mouse("mousePressed", *IN_DITCH, buttons=1)
    page.mouse("mouseReleased", *IN_DITCH)
    page.mouse("mouseMoved", *ON_FLOOR)
    page.browser.drawn()
    assert "pinned" in page.browser.text("#cell-title").lower()
    assert "obstacle" in page.browser.text("#readout dl")
    page.shot("pinned")
    page.click("#unpin")
    page.browser.run("document.getElementById('map').focus()")
    page.browser.key("keyDown", "Enter", "Enter")  # the cell in the middle: the robot's own
    page.browser.wait("document.getElementById('cell-why').innerText.includes('Floor was met')")


@pytest.mark.slow
def test_layers_have_a_scale_and_codes_have_words(page: Page) -> None:
    page.open()
    page.live()
    page.click("input[value=height]")
    page.browser.wait("mapod.live.layers.has('height')")
    page.browser.drawn()
    assert "−0.50 m" in page.browser.text("#legend")
    page.shot("height")
    for name, least, most in (("edge", "0.000 m", "0.500 m"), ("foothold", "0.00", "1.00")):
        page.click(f"input[value={name}]")
        page.browser.wait(f"mapod.live.layers.has('{name}')")
        page.browser.drawn()
        told = page.browser.text("#legend").split("\n")
        assert (told[0], told[2]) == (least, most), told
    page.click("input[value=cause]")
    page.browser.wait("mapod.live.layers.has('cause')")
    page.browser.drawn()
    assert "drop: floor was due" in page.browser.text("#legend")
    assert page.script.layers == ["cause"]


@pytest.mark.slow
def test_the_relief_turns(page: Page) -> None:
    page.open()
    page.live()
    page.click("#to-relief")
    page.browser.wait("document.getElementById('veil').hidden && mapod.live.layers.has('height')")
    page.shot("relief")
    before = Image.open(page.shots / "relief.png").convert("RGB").crop((240, 70, 840, 700))
    assert len(before.getcolors(600 * 630) or ()) > 200  # light and shade
    page.browser.run("document.getElementById('relief').focus()")
    page.browser.key("keyDown", "ArrowLeft", "ArrowLeft")
    page.shot("relief_turned")
    assert (
        Image.open(page.shots / "relief_turned.png").convert("RGB").crop((240, 70, 840, 700))
        != before
    )
    assert page.browser.complaints() == []


@pytest.mark.slow
def test_without_webgl_there_is_one_line(page: Page) -> None:
    hide = f"{PROBES}\nhideWebgl()"
    added = page.browser.cdp("Page.addScriptToEvaluateOnNewDocument", source=hide)
    page.open()
    page.live()
    page.click("#to-relief")
    page.browser.wait("document.getElementById('veil').innerText.includes('no WebGL 2')")
    page.browser.cdp("Page.removeScriptToEvaluateOnNewDocument", identifier=added["identifier"])


@pytest.mark.slow
def test_keys_alone_reach_everything_and_are_seen_to(page: Page) -> None:
    page.open()
    page.live()
    wanted = page.probe("countStops")
    seen = set()
    for _ in range(wanted + 3):
        page.browser.key("keyDown", "Tab", "Tab", windowsVirtualKeyCode=9)
        page.browser.key("keyUp", "Tab", "Tab", windowsVirtualKeyCode=9)
        which, width, html = page.probe("focused")
        assert which is None or width == "3px", html
        seen.add(which)
    assert len(seen - {None}) == wanted
    assert page.probe("nameless") == []


@pytest.mark.slow
def test_a_phone_has_all_of_it_at_360_pixels(page: Page) -> None:
    page.open(360, 740, 2.0, touch=True)
    page.live()
    page.shot("phone")
    assert page.browser.run("return document.documentElement.scrollWidth") == 360
    for tab in ("drive", "inputs", "link", "layers", "way"):
        page.click(f"[role=tab][data-tab={tab}]")
        assert page.probe("smallButtons") == []
        wide = page.browser.run(
            "return document.getElementById(arguments[0]).getBoundingClientRect().right", tab
        )
        assert 300 < wide <= 360
    page.script.over = STALE
    page.browser.condition("stale")
    page.shot("phone_stale")


@pytest.mark.slow
def test_a_token_is_asked_for_where_looking_needs_one(page: Page) -> None:
    page.script.needs_token = True
    page.open(token=False)
    page.browser.condition("token")
    page.browser.run("document.getElementById('token').focus()")
    page.browser.cdp("Input.insertText", text=TOKEN)
    page.browser.key("keyDown", "Enter", "Enter", text="\r")
    page.live()
    assert page.browser.run("return mapod.driver.token") == TOKEN


@pytest.mark.slow
def test_the_token_of_the_address_is_not_left_in_it(page: Page) -> None:
    page.open()
    page.live()
    assert TOKEN not in page.browser.driver.current_url


@pytest.mark.slow
def test_a_picture_is_saved_as_it_is_seen(page: Page, browser: Browser) -> None:
    page.open()
    page.live()
    page.click("#picture")
    name = page.browser.wait("/mapod-.*png/.exec(document.getElementById('notice').innerText)")[0]
    folder = Path(str(browser.driver.capabilities["chrome"]["userDataDir"])).parent
    page.browser.wait(lambda: (folder / name).exists())
    with Image.open(folder / name) as saved:
        assert saved.size[0] == page.browser.run("return mapod.map.canvas.width")
        pixels = np.unique(np.asarray(saved.convert("RGB")).reshape(-1, 3), axis=0)
    assert page.colour("obstacle") in {f"#{r:02x}{g:02x}{b:02x}" for r, g, b in pixels.tolist()}


def test_what_is_not_understood_is_counted_and_does_no_harm(page: Page) -> None:
    page.script.extra = [
        '{"type":"objects","t_s":1}', '{"type":"objects","t_s":1,"objects":[{"kind":3,"v":[0]}]}',
        '{"type":"path","t_s":1,"points":[1],"kinds":[0]}', '{"type":"later","t_s":1}',
        "[1]", "{", b"", b"\x01\x00\xff\xff{}", b"\x09\x00\x02\x00{}",
        b'\x01\x00\x0b\x00{"t_s":1000}\x00', b'\x02\x00\x0b\x00{"t_s":1000}\x00\x00',
    ]  # fmt: skip
    page.open()
    page.live()
    page.browser.wait("mapod.link.damaged >= 10")
    assert page.pixel(*IN_DITCH) == page.colour("obstacle")
    assert "not understood" in page.browser.run(
        "return document.getElementById('link-words').textContent"
    )
    assert page.browser.complaints() == []


@pytest.mark.slow
def test_cells_are_painted_once_a_change_and_not_once_a_frame(page: Page) -> None:
    page.open()
    page.live()
    frames, painted, versions = page.browser.driver.execute_async_script(
        f"{PROBES}\ncountPaints(arguments[0])"
    )
    assert frames == 60
    assert painted <= versions + 1 < 60


@pytest.mark.slow
def test_less_motion_is_obeyed(page: Page) -> None:
    moving = "return getComputedStyle(document.querySelector('#banner .sign')).animationName"
    page.script.over = STALE
    page.open()
    page.browser.condition("stale")
    assert page.browser.run(moving) == "pulse"
    page.browser.media(prefers_reduced_motion="reduce")
    assert page.browser.run(moving) == "none"
