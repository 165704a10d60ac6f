"""Driving from the page, in headless Chromium: nothing moves but while something is held."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.tools.view.page_at_work import Page, a_page
from tools.docs.browser import CHROMIUM, DRIVER, Browser, a_browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (CHROMIUM and DRIVER), reason="needs a browser: apt install chromium chromium-driver"
    ),
]

OTHER_WAYS = ("pagehide", "Escape", "Control", "let go")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with a_browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture
def page(browser: Browser, tmp_path: Path) -> Iterator[Page]:
    with a_page(browser, tmp_path) as at_work:
        at_work.open()
        at_work.live()
        yield at_work


def hold(page: Page) -> None:
    """Takes the wheel, and holds Shift and W until the robot is asked to drive."""
    page.click("#arm")
    page.browser.key("keyDown", "ShiftLeft", "Shift")
    page.browser.key("keyDown", "KeyW", "W")
    page.browser.wait(lambda: page.heard("drive"))


def is_still(page: Page) -> bool:
    """Whether the page has stopped, and asks for no more although the keys lie as they lay."""
    page.browser.wait(lambda: page.heard("stop"))
    asked = page.heard("drive")
    page.browser.driver.execute_async_script("setTimeout(arguments[0], 250)")
    return page.heard("drive") == asked


def test_keys_drive_only_with_the_dead_mans_key(page: Page) -> None:
    page.browser.key("keyDown", "ShiftLeft", "Shift")
    page.browser.key("keyDown", "KeyW", "W")  # the wheel is not taken
    page.browser.key("keyUp", "KeyW", "W")
    page.browser.key("keyUp", "ShiftLeft", "Shift")
    page.click("#arm")
    page.browser.key("keyDown", "KeyW", "w")  # and no dead man's key
    page.browser.driver.execute_async_script("setTimeout(arguments[0], 250)")
    assert page.heard("drive") == 0
    page.browser.key("keyDown", "ShiftLeft", "Shift")
    page.browser.wait(lambda: page.heard("drive") >= 2)
    told = page.script.said("drive")[-1]
    assert (told["v"], told["w"], told["dead_man"]) == (0.3, 0.0, True)
    assert told["t_s"] <= page.script.drive.t_s
    page.browser.wait("document.getElementById('driver').innerText.startsWith('You drive')")
    page.browser.key("keyUp", "ShiftLeft", "Shift")
    assert is_still(page)


@pytest.mark.parametrize(
    "how",
    ["blur", *(pytest.param(how, marks=pytest.mark.slow) for how in OTHER_WAYS)],
)
def test_it_stops_and_wants_the_keys_anew(page: Page, how: str) -> None:
    hold(page)
    if how in ("blur", "pagehide"):
        page.browser.run("dispatchEvent(new Event(arguments[0]))", how)
    elif how == "let go":
        page.click("#arm")
    else:
        page.browser.key("keyDown", how, how, modifiers=2 if how == "Control" else 8)
    assert is_still(page)


@pytest.mark.slow
def test_it_stops_when_another_tab_hides_it(page: Page) -> None:
    hold(page)
    driver = page.browser.driver
    here = driver.current_window_handle
    driver.switch_to.new_window("tab")
    page.browser.wait(lambda: page.heard("stop"))
    driver.close()
    driver.switch_to.window(here)


@pytest.mark.slow
def test_it_stops_when_the_page_goes(page: Page) -> None:
    hold(page)
    page.browser.driver.get("about:blank")
    page.browser.wait(lambda: page.heard("closed") and page.script.wish is None)


@pytest.mark.slow
def test_the_pad_drives_while_a_finger_is_on_it(page: Page) -> None:
    page.browser.size(360, 740, 2.0, touch=True)
    page.click("[role=tab][data-tab=drive]")
    page.click("#arm")
    page.browser.drawn()
    page.shot("pad")
    x, y = page.probe("middleOf", "#pad")
    touch = "Input.dispatchTouchEvent"
    page.browser.cdp(touch, type="touchStart", touchPoints=[{"x": x, "y": y - 4}])
    page.browser.cdp(touch, type="touchMove", touchPoints=[{"x": x + 30, "y": y - 60}])
    page.browser.wait(lambda: page.heard("drive"))
    told = page.script.said("drive")[-1]
    assert 0.2 < told["v"] <= 0.3
    assert told["w"] < 0.0  # to the right
    page.browser.cdp(touch, type="touchCancel", touchPoints=[])
    assert is_still(page)


@pytest.mark.slow
def test_a_gamepad_drives_while_its_shoulder_is_held(page: Page) -> None:
    page.probe("plugGamepad")
    page.click("#arm")
    page.browser.driver.execute_async_script("setTimeout(arguments[0], 250)")
    assert page.heard("drive") == 0
    page.browser.run("window.held = true")
    page.browser.wait(lambda: page.heard("drive"))
    assert (page.script.said("drive")[-1]["v"], page.script.said("drive")[-1]["w"]) == (0.3, 0.0)
    page.browser.run("dispatchEvent(new Event('blur'))")
    assert is_still(page)  # although the shoulder is still held


@pytest.mark.slow
def test_where_it_may_not_it_says_why_and_asks_for_nothing(page: Page) -> None:
    page.script.refusal = "[robot] enable_motors is false"
    page.open()
    page.live()
    page.browser.wait("document.getElementById('arm').disabled")
    assert "only looks on" in page.browser.text("#advice span")
    page.browser.key("keyDown", "ShiftLeft", "Shift")
    page.browser.key("keyDown", "KeyW", "W")
    page.browser.wait("document.getElementById('who').innerText.includes('enable_motors is false')")
    page.shot("refused")
    page.browser.driver.execute_async_script("setTimeout(arguments[0], 250)")
    assert page.heard("drive") == 0


@pytest.mark.slow
def test_a_wrong_token_drives_nothing_and_is_asked_for_again(page: Page) -> None:
    page.browser.run("mapod.driver.token = 'a wrong one'")
    hold(page)
    page.browser.wait("document.getElementById('who').innerText.includes('needs the token')")
    assert page.browser.run("return document.getElementById('token-form').checkVisibility()")
    assert page.script.wish is None
