"""The tick as WebAssembly: its rate against native code in one run, sizes, memory, and the start of the page.

    python benchmarks/web.py            needs node or playwright, and chromium for the last lines
    python benchmarks/web.py --hour     an hour of simulated time, whose memory must stay the same
    python benchmarks/web.py --bytes    a table of all shipped graphs: streams with equal bytes in 6.3 s
    python benchmarks/web.py --gallery  touches of the documentation (docs/site/touches.py): size, first touch, all runs

Rates are ticks per second of processor time of a shipped run, native and in Node one after the other, so that other
programs disturb both equally; the best of three. In Chromium the page steps without drawing.
"""

from __future__ import annotations

import functools
import hashlib
import http.server
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import palpate
from palpate.launch.load.arguments import describe_run
from palpate.launch.load.launchfile import LaunchFile, find, names
from palpate.launch.run.progress import StageBars
from palpate.physics.errors import PalpateError, PalpateWarning
from palpate.web.folder import build
from palpate.web.program import compile_program
from palpate.web.started import Started, started
from palpate.web.variants import Place

TICKS = 6300
BODIES = ("MassSpring", "ReducedFE", "BeamBundle", "Rigid")
SOFTWARE = ["--no-sandbox", "--enable-unsafe-swiftshader"]
SLOWER = 4  # factor by which Chromium slows the page down
TOUCHES = Path(__file__).parents[1] / "docs" / "touches"
SCRIPT = Path(__file__).with_suffix(".mjs")


def node() -> str:
    """The program: that of the system, or of the wheel of playwright."""
    found = shutil.which("node")
    if found is None:
        import playwright

        found = str(Path(playwright.__file__).parent / "driver" / "node")
    return found


def run_in_node(run: Started, ticks: int, turns: int = 1, hashes: bool = False) -> dict[str, Any]:
    """What the script prints about ticks of a started run."""
    program = compile_program([run.segment])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program.save(folder, program.describe(run))
        text = (resources.files("palpate.web") / "static" / "tick.js").read_text(encoding="utf-8")
        (folder / "tick.mjs").write_text(text, encoding="utf-8")
        shutil.copy(SCRIPT, folder)
        command = [node(), SCRIPT.name, str(ticks), str(turns), str(int(hashes))]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    return json.loads(done.stdout) | {"code": len(program.code.code)}


def launched(graph: str, body: str | None = None) -> LaunchFile:
    sets = [f"tissue.use=deformation.{body}"] if body else []
    return describe_run(graph, scene=None, duration=None, sets=sets, nodes={})


def native_rate(run: Started) -> float:
    """Ticks per second of processor time of native code."""
    begun = time.thread_time()
    run.segment.run_many(0, TICKS)
    return TICKS / (time.thread_time() - begun)


def print_rates() -> None:
    print(f"{'kidney with':12} {'native':>9} {'wasm':>9} {'ratio':>6} {'code':>8} {'arrays':>8} {'heap':>7}")
    for body in BODIES:
        with started(launched("kidney", body)) as run:
            found = run_in_node(run, TICKS, turns=3)
            native = native_rate(run)
        rate = TICKS / min(found["seconds"])
        rates = f"{native / 1e3:5.1f} kHz {rate / 1e3:5.1f} kHz {native / rate:6.1f}"
        print(f"{body:12} {rates} {found['code'] / 1e3:5.0f} kB "
              f"{(found['memory'] - (1 << 24)) / 1e6:5.1f} MB {found['heap'] / 1e3:4.1f} kB")  # fmt: skip


def print_hour() -> None:
    """Two runs of the same nodes, of a minute and of an hour."""
    for seconds in (60, 3600):
        with started(launched("kidney")) as run:
            found = run_in_node(run, seconds * 1000)
        print(f"{seconds:5} s simulated: heap {found['heap']} bytes, process {found['resident'] / 1e6:.0f} MB, "
              f"{seconds / found['seconds'][0]:.0f} kHz, failed: {found['failed']}")  # fmt: skip


def print_bytes() -> None:
    """For each graph the streams that are equal, those that differ, and why it cannot run."""
    warnings.simplefilter("ignore", PalpateWarning)  # of the native runs, about their laws
    graphs = {find(name).graph: name for name in reversed(names())}  # several launch files may run one graph
    cases = [("kidney", body) for body in BODIES] + [(name, None) for name in graphs.values() if name != "kidney"]
    for graph, body in cases:
        title = f"{graph} {body or ''}"
        try:
            with started(launched(graph, body)) as run:
                found = run_in_node(run, TICKS, hashes=True)
                left = ", ".join(run.left_out)
                rate = run.planned.graph.rate
        except PalpateError as error:
            print(f"{title:24} cannot run: {str(error)[:110]}")
            continue
        native = recorded(graph, body, TICKS / rate)
        equal = [name for name, digest in found["sums"].items() if native.get(name) == digest]
        other = [name for name in found["sums"] if name not in equal]
        differ = f"; differ: {', '.join(other)}" if other else ""
        print(f"{title:24} {len(equal):2} of {len(found['sums']):2} streams equal{differ}"
              f"{f'; left out: {left}' if left else ''}")  # fmt: skip


def recorded(graph: str, body: str | None, seconds: float) -> dict[str, str]:
    """Digests of all streams of a native run."""
    from palpate.records.reader import Recording

    sums: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        given: Any = {"tissue": f"deformation.{body}"} if body else {}
        palpate.run(graph, record=Path(folder) / "native.mcap", duration=seconds, **given)
        for stream, _, payload in Recording(Path(folder) / "native.mcap").payloads():
            sums.setdefault(stream, hashlib.sha256()).update(payload)
    return {name: one.hexdigest() for name, one in sums.items()}


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """The address of a server of static files."""

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *given: Any) -> None:
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


def print_page() -> None:
    """Sizes of the folder, and in Chromium the start of the page and the rate of a page that only steps."""
    with tempfile.TemporaryDirectory() as name:
        begun = time.process_time()
        with StageBars(True) as bars:
            built = build([Place(launched("kidney"))], Path(name) / "site", [], lambda stage: bars.begin(stage))
        print(f"\nfolder of kidney: {built.variants} variants, {built.whole / 1e6:.1f} MB")
        print(f"built in {time.process_time() - begun:.0f} s of processor time")
        print(f"the page loads {built.first / 1e6:.2f} MB at first, with {built.code / 1e3:.0f} kB of code")
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        if chromium is None:
            print("no Chromium: apt install chromium")
            return
        from playwright.sync_api import sync_playwright

        with served(Path(name)) as address, sync_playwright() as play:
            browser = play.chromium.launch(
                executable_path=chromium, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
            )
            for slower in (1, SLOWER):
                page = browser.new_page(bypass_csp=True)
                session = page.context.new_cdp_session(page)
                session.send("Emulation.setCPUThrottlingRate", {"rate": slower})
                session.send("Performance.enable")
                page.goto(f"{address}/site/index.html")
                page.wait_for_function("window.palpate && palpate.newest")
                spent = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
                wall, own = page.evaluate("performance.now()") * 1e-3, spent["ScriptDuration"]
                print(f"page {slower} x slower: first frame after {wall:.2f} s")
                print(f"    processor time {spent['ProcessTime']:.2f} s, of its scripts {own:.2f} s")
                page.close()
            for body in ("MassSpring", "ReducedFE"):
                page = browser.new_page()
                session = page.context.new_cdp_session(page)
                session.send("Performance.enable")
                page.goto(f"{address}/site/page.css")
                page.evaluate(BEGIN.replace("BODY", body).replace("ADDRESS", address))
                spent = []
                for _ in range(3):
                    before = process_time(session)
                    page.evaluate("window.touch.step(20)")
                    spent.append(process_time(session) - before)
                print(f"Chromium, {body}: {20.0 / min(spent):.1f} kHz of processor time while the finger presses")
                page.close()
            browser.close()


def print_gallery() -> None:
    """For each touch of the documentation what it loads, the processor time of its page until a finger that presses at
    once has a force, and what its console says; then the same of the other runs that its switch offers.

    The time is that of the page's process on this machine, times SLOWER. The slowing of Chromium is shown with it, next
    to an empty page: it keeps the processor busy also while the page waits, so most of that figure is not the page's.
    """
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if not any(TOUCHES.glob("*/index.html")) or chromium is None:
        print("needs Chromium, and python docs/site/touches.py")
        return
    with served(TOUCHES) as address, sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=SOFTWARE)
        empty = [spent_by(browser, "about:blank", slower, lambda page: None)[0] for slower in (1, 1, SLOWER)]
        print(f"{'':12} an empty page {SLOWER * empty[1]:5.2f} s, slowed by Chromium {empty[2]:5.2f} s")
        for folder in sorted(each.parent for each in TOUCHES.glob("*/index.html")):
            where = f"{address}/{folder.name}/index.html"
            spent = min(spent_by(browser, where, 1, touch)[0] for _ in range(3))
            slowed, (loaded, others, problems) = spent_by(browser, where, SLOWER, touch_all)
            then = "".join(f"; then {name}: {force:.2f} N" for name, force in others)
            print(f"{folder.name:12} {loaded / 1e6:5.2f} MB, {SLOWER * spent:5.2f} s to the first touch, slowed by "
                  f"Chromium {slowed:5.2f} s{then}; console: {', '.join(problems) or 'nothing'}")  # fmt: skip
        browser.close()


def spent_by(browser: Any, address: str, slower: float, act: Callable[[Any], Any]) -> tuple[float, Any]:
    """Processor time [s] of a new page until `act` has begun to return, and what it returns."""
    page = browser.new_page(bypass_csp=True)
    page.problems = []
    page.on("console", lambda it: page.problems.append(it.text) if it.type == "error" else None)
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.session = page.context.new_cdp_session(page)
    page.session.send("Emulation.setCPUThrottlingRate", {"rate": slower})
    page.session.send("Performance.enable")
    page.goto(address)
    page.wait_for_load_state()
    page.spent = None
    found = act(page)
    spent = page.spent if page.spent is not None else process_time(page.session)
    page.close()
    return spent, found


def touch(page: Any) -> float:
    """Press until there is a force [N]; the processor time until then is kept."""
    page.wait_for_function("window.palpate && palpate.newest")
    page.evaluate(PRESS)
    page.wait_for_function("palpate.newest.load > 0")
    page.spent = process_time(page.session)
    return float(page.evaluate("palpate.newest.load"))


def touch_all(page: Any) -> tuple[int, list[tuple[str, float]], list[str]]:
    """What a page has loaded [bytes] until its first touch, the force of each other run of its switch, its problems."""
    touch(page)
    spent, loaded, others = page.spent, page.evaluate(LOADED), []
    for name in page.evaluate("palpate.about.scenes.slice(1)"):
        page.evaluate(LIFT)
        page.select_option("#scene", name)
        page.wait_for_function("(name) => palpate.newest && palpate.about.scene === name", arg=name)
        others.append((name, touch(page)))
    page.spent = spent
    return loaded, others, page.problems


def process_time(session: Any) -> float:
    """Processor time [s] of the page's process."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(each["value"] for each in metrics if each["name"] == "ProcessTime"))


BEGIN = """async () => {
    const { load } = await import("ADDRESS/site/palpate.mjs");
    window.touch = await load("ADDRESS/site", { body: "BODY" });
    const [x, y, z] = touch.about.pointers[0].begin;
    touch.point([x, y, z - 0.03]);
    touch.step(3);
}"""


PRESS = """() => {
    const view = document.getElementById("view"), { left, top, width, height } = view.getBoundingClientRect();
    const at = { clientX: left + 0.5 * width, clientY: top + 0.45 * height, pointerId: 1, bubbles: true };
    view.setPointerCapture = () => {};
    view.dispatchEvent(new PointerEvent("pointerdown", at));
}"""
LIFT = """() => {
    document.getElementById("view").dispatchEvent(new PointerEvent("pointerup", { pointerId: 1, bubbles: true }));
}"""
LOADED = """performance.getEntriesByType("resource").concat(performance.getEntriesByType("navigation"))
    .reduce((sum, { transferSize }) => sum + transferSize, 0)"""


if __name__ == "__main__":
    if "--bytes" in sys.argv:
        print_bytes()
    elif "--gallery" in sys.argv:
        print_gallery()
    elif "--hour" in sys.argv:
        print_hour()
    else:
        print_rates()
        print_page()
