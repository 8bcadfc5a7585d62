"""A real Firefox without a window, for the tests of pages, by its Marionette protocol: JSON with its length.

Marionette is part of Firefox (https://firefox-source-docs.mozilla.org/testing/marionette/Protocol.html), so that the
tests need no driver. Scripts run outside of the security policy of the page.
"""

import json
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

FIREFOX = shutil.which("firefox-esr") or shutil.which("firefox")
NEEDED = [pytest.mark.long, pytest.mark.skipif(FIREFOX is None, reason="no Firefox: apt install firefox-esr")]
WAIT = 180.0  # [s] timeout on a busy machine
PORT_FILE = "MarionetteActivePort"
SETTINGS = {
    "marionette.port": 0,  # any free one, which Firefox writes to a file of its profile
    "webgl.force-enabled": True,  # also with a software renderer
    "browser.download.folderList": 2,
    "browser.helperApps.neverAsk.saveToDisk": "application/octet-stream",
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "toolkit.telemetry.reportingpolicy.firstRun": False,
    "app.update.enabled": False,
}


class Page:
    """The page of a Firefox that listens at a port."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=WAIT)
        self._file, self._number = self._socket.makefile("rb"), 0
        self._receive()  # its greeting
        self.about = self.order("WebDriver:NewSession", {})["capabilities"]

    def order(self, name: str, given: dict[str, Any]) -> Any:
        """The answer to a command. AssertionError: it failed."""
        self._number += 1
        text = json.dumps([0, self._number, name, given]).encode()
        self._socket.sendall(b"%d:%s" % (len(text), text))
        _, number, error, answer = self._receive()
        assert number == self._number and error is None, error
        return answer

    def _receive(self) -> Any:
        length = b""
        while (digit := self._file.read(1)) != b":":
            assert digit, "Firefox has closed the connection"
            length += digit
        return json.loads(self._file.read(int(length)))

    def evaluate(self, expression: str, *given: Any) -> Any:
        """The value of an expression in the page; `arguments` are the given ones."""
        script = {"script": f"const palpate = window.wrappedJSObject.palpate; return {expression};", "args": given}
        return self.order("WebDriver:ExecuteScript", script | {"sandbox": "default"})["value"]

    def wait_for(self, expression: str) -> None:
        """Wait until an expression is true. AssertionError: it stays false; says what the page shows."""
        end = time.monotonic() + WAIT
        while not self.evaluate(f"Boolean({expression})"):
            assert time.monotonic() < end, (expression, self.evaluate("document.body.innerText"))
            time.sleep(0.1)

    def mouse(self, *actions: dict[str, Any]) -> None:
        """Actions of the mouse: {"type": "pointerMove", "x": 1, "y": 2}, "pointerDown", "pointerUp"."""
        filled = [{"button": 0, "duration": 0, **each} for each in actions]
        self.order("WebDriver:PerformActions", {"actions": [{"type": "pointer", "id": "mouse", "actions": filled}]})

    def close(self) -> None:
        self._file.close()
        self._socket.close()


@contextmanager
def opened(address: str, ready: str, folder: Path) -> Iterator[Page]:
    """The page at an address after the expression `ready` is true in it. Downloads and the profile of Firefox are in a
    folder."""
    assert FIREFOX is not None
    profile = folder / "profile"
    profile.mkdir()
    settings = SETTINGS | {"browser.download.dir": str(folder)}
    lines = [f'user_pref("{name}", {json.dumps(value)});\n' for name, value in settings.items()]
    (profile / "user.js").write_text("".join(lines), encoding="utf-8")
    size = ["--width=1000", "--height=800"]
    command = [FIREFOX, "--headless", "--marionette", "--no-remote", "--profile", str(profile), *size]
    running = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        end = time.monotonic() + WAIT
        while not (profile / PORT_FILE).exists() or not (profile / PORT_FILE).read_text().strip():
            assert running.poll() is None and time.monotonic() < end, "Firefox does not start"
            time.sleep(0.1)
        page = Page(int((profile / PORT_FILE).read_text()))
        page.order("WebDriver:Navigate", {"url": address})
        page.wait_for(ready)
        yield page
        page.close()
    finally:
        running.terminate()
        running.wait(WAIT)
