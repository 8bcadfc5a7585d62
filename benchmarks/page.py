"""Frame rate, latency and late ticks of the page of `palpate touch` in Chromium's software renderer.

    python benchmarks/page.py [GRAPH]     needs chromium and playwright

Late ticks are counted with and without the page. The latency is the time from a sample of the pointer to the frame that
shows its force.
"""

from __future__ import annotations

import json
import shutil
import statistics
import struct
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from palpate.launch.load.launchfile import find
from palpate.views.page import serve
from palpate.views.page.session import Session

SOFTWARE = ["--no-sandbox", "--enable-unsafe-swiftshader"]
"""Chromium's default without a GPU: SwiftShader renders WebGL, and the page is composited without it."""
SPAN = 8.0  # [s]


def main(graph: str) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        session = Session(find(graph), Path(folder), [])
        page = serve(session)
        try:
            while not session.frame:
                time.sleep(0.1)
            before = late(session)
            time.sleep(SPAN)
            print(f"{graph}, {SPAN:.0f} s each")
            print(f"late ticks without a page   {late(session) - before} of {SPAN * 1000:.0f}")
            with sync_playwright() as play:
                browser = play.chromium.launch(executable_path=shutil.which("chromium"), args=SOFTWARE)
                measure(browser, page.address, session)
                browser.close()
        finally:
            page.close()


def late(session: Session) -> int:
    """Late ticks of the loop so far, from the newest frame."""
    (length,) = struct.unpack_from("<I", session.frame)
    return int(json.loads(session.frame[4 : 4 + length])["late"])


def measure(browser: Browser, address: str, session: Session) -> None:
    """Press and stroke on the page at 1280 x 800 pixels, and print its figures."""
    view = browser.new_page(bypass_csp=True, viewport={"width": 1280, "height": 800})
    view.goto(address)
    view.wait_for_function("window.palpate && palpate.newest")
    view.mouse.move(640, 370)
    view.mouse.down()
    time.sleep(2.0)
    before, frames, begun, delays = late(session), view.evaluate("palpate.frames"), time.monotonic(), []
    while time.monotonic() - begun < SPAN:
        view.mouse.move(600 + 5 * (len(delays) % 16), 370)
        time.sleep(0.05)
        delays.append(view.evaluate("palpate.latency"))
    wall = time.monotonic() - begun
    print(f"late ticks with the page    {late(session) - before} of {wall * 1000:.0f}")
    print(f"frames                      {(view.evaluate('palpate.frames') - frames) / wall:.1f} /s")
    print(f"pointer to frame, median    {statistics.median(delays):.0f} ms")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "kidney")
