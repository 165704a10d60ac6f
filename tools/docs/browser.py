"""A headless Chromium: for pictures of the live page, and for its tests."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
PATIENCE_S = 15.0
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--hide-scrollbars",
    "--no-first-run",
    "--disable-gpu", "--enable-unsafe-swiftshader", "--force-color-profile=srgb",
    "--disable-background-networking", "--disable-extensions", "--disable-component-update",
)  # fmt: skip


class Browser:
    """One tab. Scripts see the page as `mapod`."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(
        self,
        url: str,
        width: int = 1280,
        height: int = 800,
        ratio: float = 1.0,
        touch: bool = False,
    ) -> None:
        self.size(width, height, ratio, touch)
        self.driver.get("about:blank")
        self.driver.get(url)

    def size(self, width: int, height: int, ratio: float = 1.0, touch: bool = False) -> None:
        metrics = {"width": width, "height": height, "deviceScaleFactor": ratio, "mobile": touch}
        self.cdp("Emulation.setDeviceMetricsOverride", **metrics)
        self.cdp("Emulation.setTouchEmulationEnabled", enabled=touch)

    def media(self, **features: str) -> None:
        """Such as prefers_color_scheme="dark"."""
        told = [
            {"name": name.replace("_", "-"), "value": value} for name, value in features.items()
        ]
        self.cdp("Emulation.setEmulatedMedia", features=told)

    def cdp(self, command: str, **parameters: object) -> Any:
        return self.driver.execute_cdp_cmd(command, parameters)

    def run(self, script: str, *arguments: object) -> Any:
        return self.driver.execute_script(script, *arguments)

    def text(self, css: str) -> str:
        return str(self.run("return document.querySelector(arguments[0]).innerText", css))

    def wait(self, what: str | Callable[[], object]) -> Any:
        """Until an expression of the page, or a function here, is true; gives its value."""
        until_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < until_s:
            value = self.run(f"return {what}") if isinstance(what, str) else what()
            if value:
                return value
            time.sleep(0.02)
        raise AssertionError(f"never true: {what}\n{self.complaints()}")

    def condition(self, key: str) -> None:
        """Waits until the page says so of itself."""
        self.wait(f"document.documentElement.dataset.condition === '{key}'")

    def drawn(self) -> None:
        """Waits until what has come is drawn."""
        self.driver.execute_async_script(
            "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(done))"
        )

    def shot(self, path: Path) -> Path:
        self.drawn()
        self.driver.save_screenshot(str(path))
        return path

    def key(self, kind: str, code: str, key: str, **more: object) -> None:
        """A key goes down (`keyDown`) or up (`keyUp`)."""
        self.cdp("Input.dispatchKeyEvent", type=kind, code=code, key=key, **more)

    def complaints(self) -> list[str]:
        """What the browser has logged as an error since it was asked last."""
        return [
            entry["message"]
            for entry in self.driver.get_log("browser")
            if entry["level"] == "SEVERE"
        ]


@contextmanager
def a_browser(folder: Path) -> Iterator[Browser]:
    """`folder` holds its profile, and what it downloads."""
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM or ""
    for flag in (*FLAGS, f"--user-data-dir={folder / 'profile'}"):
        options.add_argument(flag)
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    os.environ.setdefault("SE_OFFLINE", "true")
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        yield Browser(driver)
    finally:
        driver.quit()
