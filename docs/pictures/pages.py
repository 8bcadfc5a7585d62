"""Draw the pictures of the pages, with Chromium: python docs/pictures/pages.py [folder]

touch.png  `palpate touch kidney` while the mouse presses
view.png   `palpate view` of two recordings of one touch, MassSpring and ReducedFE, at its deepest instant
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.views.page.feed import FrameSource
from palpate.views.page.reel import Reels
from palpate.views.page.server import PageServer
from palpate.views.page.session import Session

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
SIZE = {"width": 1280, "height": 740}
WAIT = 300e3  # [ms] on a busy machine
DEEPEST = 4.06  # [s]
SLOW = 500  # [ms] delay of a busy machine
REST = 1500  # [ms] until the hand rests, or the frame is drawn


@contextmanager
def page(source: FrameSource) -> Iterator[Any]:
    """A window with the page of a source."""
    server = PageServer(source)
    try:
        with sync_playwright() as play:
            options = ["--no-sandbox", "--enable-unsafe-swiftshader"]
            browser = play.chromium.launch(executable_path=CHROMIUM, args=options)
            window = browser.new_page(bypass_csp=True, viewport=SIZE)
            window.set_default_timeout(WAIT)
            window.goto(server.address)
            yield window
            browser.close()
    finally:
        server.close()


def touched(target: Path, scratch: Path) -> None:
    """Press, move along the surface, rest."""
    with page(Session(find("kidney"), scratch, [])) as window:
        window.wait_for_function("palpate.newest")
        box = window.locator("#view").bounding_box()
        x, y = box["x"] + 0.45 * box["width"], box["y"] + 0.45 * box["height"]
        window.mouse.move(x, y)
        window.mouse.down()
        for step in range(20):
            window.mouse.move(x + 4 * step, y)
            window.wait_for_timeout(100)
        window.wait_for_timeout(REST)
        window.mouse.move(x + 80, y)  # the delay of the first samples contains that of the start
        window.wait_for_function(f"palpate.newest.load > 0.5 && palpate.scene.moved.length && palpate.latency < {SLOW}")
        window.screenshot(path=target)


def compared(target: Path, scratch: Path) -> None:
    """The same motion of the hand on two bodies."""
    files = []
    for body in ("MassSpring", "ReducedFE"):
        files.append(scratch / f"{body}.mcap")
        run = find("kidney").but(place="fused", record=files[-1], overrides=[f"tissue.use=deformation.{body}"])
        if not (outcome := execute(run)).result.ok:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
    with page(Reels(files)) as window:
        window.wait_for_function("palpate.frames > 0 && document.getElementById('status').textContent === ''")
        window.evaluate(
            f"const t = document.getElementById('time'); t.value = {DEEPEST}; t.dispatchEvent(new Event('input'))"
        )
        window.wait_for_function(f"Math.abs(palpate.time - {DEEPEST}) < 2e-3")
        window.wait_for_timeout(REST)
        window.screenshot(path=target)


def main(place: Path) -> list[Path]:
    """Run, press, take pictures."""
    place.mkdir(parents=True, exist_ok=True)
    targets = [place / "touch.png", place / "view.png"]
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        touched(targets[0], Path(scratch))
        compared(targets[1], Path(scratch))
    return targets


if __name__ == "__main__":
    from target import folder

    print(*main(folder(__doc__)), sep="\n")
