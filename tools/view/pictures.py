"""Takes the documents' pictures of the live page: a simulated drive, in a headless browser.

It starts `mapod demo`, opens the page that its first line names, and writes docs/pictures.
"""

import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tools.docs.browser import CHROMIUM, DRIVER, Browser, a_browser
from tools.docs.pictures import PICTURES, record

DRAWN_BY = ("tools/view/page/*.js", "tools/view/page/page.css", "tools/view/page/index.html")
DEMO = ("-m", "mapod", "demo", "--scene", "corridor", "--seed", "1", "--seconds", "600")
RUNNING = "mapod.live.state?.mode === 1 && Math.abs(mapod.live.state.pose.yaw) < 0.5"
SETTLED = f"mapod.path.points.length > 80 && {RUNNING} && mapod.live.state.zone?.free_ahead_m > 1.5"
PATIENCE_S = 150.0  # kernels may have to be compiled
NEAREST_OBSTACLE = """
const { i, j, size, cells } = mapod.live.window, { x, y } = mapod.live.state.pose;
const cell_m = mapod.live.window.cell_m, found = [];
cells.forEach((state, k) => {
  const column = i + (k % size), row = j + Math.floor(k / size);
  const away_m = Math.hypot((column + 0.5) * cell_m - x, (row + 0.5) * cell_m - y);
  if (state === 2) found.push({ i: column, j: row, away_m });
});
mapod.readout.pin(found.sort((a, b) => a.away_m - b.away_m)[0]);
"""


def wait(browser: Browser, what: str) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        if browser.run(f"return {what}"):
            return
        time.sleep(0.2)
    raise SystemExit(f"never true: {what}")


def take(browser: Browser, url: str) -> list[str]:
    """The three pictures."""
    browser.media(prefers_color_scheme="light")
    browser.open(url, 1280, 800)
    wait(browser, "document.documentElement.dataset.condition === 'live'")
    wait(browser, SETTLED)
    browser.run(NEAREST_OBSTACLE)
    wait(browser, "document.getElementById('cell-why').innerText !== ''")
    browser.shot(PICTURES / "view.png")
    browser.media(prefers_color_scheme="dark")
    browser.run("mapod.readout.pin(null); document.querySelector('input[value=height]').click()")
    browser.run("document.getElementById('to-relief').click(); mapod.camera.turn(0.5, 0)")
    wait(browser, "document.getElementById('veil').hidden && mapod.live.layers.has('height')")
    time.sleep(6.0)  # a layer comes piece by piece
    browser.shot(PICTURES / "view-relief.png")
    browser.run("document.getElementById('to-relief').click()")
    browser.run("document.querySelector('input[value=state]').click()")
    browser.size(360, 740, 2.0, touch=True)
    browser.media(prefers_color_scheme="light")
    browser.drawn()
    wait(browser, "document.documentElement.dataset.condition === 'live'")
    browser.shot(PICTURES / "view-phone.png")
    return ["view.png", "view-relief.png", "view-phone.png"]


def main() -> int:
    if not (CHROMIUM and DRIVER):
        print("mapod: needs a browser: apt install chromium chromium-driver", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="mapod-pictures-") as folder:
        demo = subprocess.Popen([sys.executable, *DEMO], stdout=subprocess.PIPE, text=True)
        try:
            assert demo.stdout is not None
            found = re.search(r"http://\S+", demo.stdout.readline())
            if found is None:
                print("mapod: the demo has told no address in its first line", file=sys.stderr)
                return 1
            with a_browser(Path(folder)) as browser:
                record(take(browser, found[0]), "make pictures", DRAWN_BY)
        finally:
            demo.send_signal(signal.SIGINT)
            demo.communicate(timeout=30.0)
    print(f"mapod: pictures in {PICTURES}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
