"""The process that shows a run while it goes on: `palpate run --view`. It is no part of the run and cannot slow it.

Reads one line of JSON from standard input (plan, process of the launcher, groups, how), answers one line on standard
output, and ends when standard input does, its window is closed, or the run has ended and its last page is closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

from palpate.engine.plan import Plan
from palpate.launch.load.launchfile import LaunchFile
from palpate.nodes.base.effect import effects
from palpate.physics.errors import MISUSE, PalpateError
from palpate.views.page import needs

WAYS = ("window", "web")
SHAPE = "shape"
PATIENCE = 60.0
"""[s] for a window to open."""
RELOAD = 2.0
"""[s] for a page to be loaded anew, before it counts as closed."""
BEHIND = 10
"""By which it stands behind the nodes of a run for a processor."""


class Unseen(PalpateError, ValueError):
    """Why a run cannot be looked at while it goes on."""

    exit_code = MISUSE


def watchable(launch: LaunchFile) -> LaunchFile:
    """The run with the shape of its body computed, though no node of it may read that; at the pace of the world, as
    one that is faster is over before it is seen."""
    can = {effect.name for spec in launch.load().nodes.values() for effect in effects(spec.cls)}
    shape = [f"effects.{SHAPE}=on"] if SHAPE in can else []
    return launch.but(overrides=shape, pace=1.0 if launch.clock != "real" and launch.pace is None else None)


def onlooker(launch: LaunchFile, how: str) -> Onlooker:
    """Open a window, or the page, for a run that this process is about to begin. PalpateError: why there is none."""
    from palpate.views.page.window import why_not

    if how == "window" and (why := why_not()):
        raise Unseen(f"--view: {why}. --view web shows it in the browser, over ssh as well")
    if how == "web":
        needs.check()
    planned = launch.plan()
    groups = launch.placement(planned).groups
    if len(groups) == 1 and launch.clock != "real":
        raise Unseen("--view: a run in one process on the simulated clock has nothing to listen to; leave out --fused, "
                     "or look at its recording: palpate view FILE")  # fmt: skip
    nodes = set(planned.order)
    return Onlooker(planned, os.getpid(), {group.name for group in groups if nodes & set(group.nodes)}, how)


class Onlooker:
    """The process, from the side of the run.

    planned   what runs
    launcher  process that the run is of
    groups    of nodes, as they are placed
    how       "window" or "web"

    PalpateError: why there is nothing to see.
    """

    def __init__(self, planned: Plan, launcher: int, groups: set[str], how: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            start_new_session=True,  # Ctrl-C ends the run, and then this
        )  # fmt: skip
        assert self._process.stdin is not None and self._process.stdout is not None
        asked = {"plan": planned.to_spec(), "launcher": launcher, "groups": sorted(groups), "how": how}
        self._process.stdin.write(json.dumps(asked, default=list) + "\n")
        self._process.stdin.flush()
        late = threading.Timer(PATIENCE, self._process.kill)
        late.start()
        answer = self._process.stdout.readline()
        late.cancel()
        told = json.loads(answer) if answer else {"error": f"--view: nothing opened within {PATIENCE:g} s"}
        if "error" in told:
            self.close()
            raise Unseen(told["error"])
        self.address: str = told["address"]

    def wait(self) -> None:
        """Until its window is closed."""
        self._process.wait()

    def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def main() -> None:
    """Show what standard input asks for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.nice(BEHIND)
    os.environ["LP_NUM_THREADS"] = "1"  # Mesa's software renderer takes all cores otherwise
    asked = json.loads(sys.stdin.readline())
    try:
        _show(asked)
    except PalpateError as error:
        _answer({"error": f"{error}{' ' + error.hint if error.hint else ''}"})
        raise SystemExit(error.exit_code) from None


def _show(asked: dict[str, Any]) -> None:
    from palpate.views.page.watch import Watch

    watch = Watch(Plan.from_spec(asked["plan"]), asked["launcher"], set(asked["groups"]))
    if asked["how"] == "web":
        asyncio.run(_serve(watch))
        return
    from palpate.views.page.window import Window

    window = Window(watch)
    window.open()
    watch.start()
    threading.Thread(target=_end_with_the_run, args=(window,), daemon=True).start()
    _answer({"address": ""})
    window.run()
    watch.close()


async def _serve(watch: Any) -> None:
    from palpate.views.page.live import Live

    page = Live(watch)
    await page.start(0)
    watch.start()
    _answer({"address": page.address})
    launcher_gone = asyncio.Event()
    # No thread: one that reads could not be ended when the last page is closed.
    asyncio.get_running_loop().add_reader(sys.stdin.fileno(), launcher_gone.set)
    while not (launcher_gone.is_set() or (watch.over and _nobody_looks(page))):
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(launcher_gone.wait(), 0.5)
    await page.close()
    watch.close()


def _nobody_looks(page: Any) -> bool:
    """Whether the last page has been closed, and is not loaded anew."""
    return not page.open and page.left > 0.0 and time.monotonic() - page.left > RELOAD


def _end_with_the_run(window: Any) -> None:
    sys.stdin.read()
    window.ended = True


def _answer(told: dict[str, str]) -> None:
    print(json.dumps(told), flush=True)


if __name__ == "__main__":
    main()
