"""A real Chromium with software rendering, for the tests of pages."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
NEEDED = [pytest.mark.long, pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt install chromium")]
SOFTWARE = ["--no-sandbox", "--enable-unsafe-swiftshader"]
WAIT = 90.0  # [s] timeout on a busy machine


def _is_ours(message: Any) -> bool:
    """Whether a line of the console concerns the page, not the rendering of Chromium without a GPU."""
    return message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text


@contextmanager
def opened(address: str, ready: str, scripts: Sequence[str] = ()) -> Iterator[Any]:
    """The page at an address after the expression `ready` is true in it; `problems` has the lines of its console.

    scripts  run before those of the page
    """
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        # The test evaluates texts, which the page's security policy forbids.
        page = browser.new_page(bypass_csp=True, viewport={"width": 1000, "height": 700})
        page.set_default_timeout(1e3 * WAIT)
        page.problems = []
        page.on("console", lambda it: page.problems.append(it.text) if _is_ours(it) else None)
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        for script in scripts:
            page.add_init_script(script)
        page.goto(address)
        page.wait_for_function(ready)
        yield page
        browser.close()
