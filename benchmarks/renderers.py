"""Rate and size of the frames for external renderers (docs/renderers.md), and their cost for the loop.

    python benchmarks/renderers.py [--turns N] [--json]

Runs `palpate touch kidney` without a browser, with the finger pressed in. Spans of 4 s without a client and with one
alternate. Processor time: that of the processes of the run, and that of this process, which serves the frames; the
client is a separate process. The run counts its late ticks.
"""

from __future__ import annotations

import multiprocessing
import os
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import psutil
from tables import parser, print_tables
from websockets.sync.client import connect

from palpate.launch.load.launchfile import find
from palpate.views.page import serve
from palpate.views.page.feed import FRAME, binary
from palpate.views.page.session import Session

SPAN = 4.0  # [s]
PRESSED = '{"point": [1, [0, 0, 0.098], 1]}'
TICK = os.sysconf("SC_CLK_TCK")


def listen(address: str, pipe: Connection) -> None:
    """A client: at each request on the pipe, it answers with the frames since the last one and their bytes."""
    frames = size = 0
    with connect(address, max_size=None, compression=None) as socket:
        while True:
            data = socket.recv()
            if isinstance(data, bytes) and data[:4] == b"PLPF":
                frames, size = frames + 1, size + len(data)
            if pipe.poll():
                if not pipe.recv():
                    return
                pipe.send((frames, size))
                frames = size = 0


def busy(processes: set[int]) -> float:
    """Processor time [s] of the processes so far."""
    total = 0
    for process in processes:
        numbers = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
        total += int(numbers[11]) + int(numbers[12])
    return total / TICK


def span(session: Session, run: set[int], address: str, client: bool) -> dict[str, float]:
    """Shares of a core and late ticks in one span, and the frames that the client received."""
    row: dict[str, float] = {}
    if client:
        context = multiprocessing.get_context("spawn")
        pipe, end = context.Pipe()
        process = context.Process(target=listen, args=(address, end))
        process.start()
        time.sleep(2.0)
        pipe.send(True)
        pipe.recv()
    late = FRAME.unpack_from(binary(session.frame))[4]
    before, served, begun = busy(run), busy({os.getpid()}), time.monotonic()
    time.sleep(SPAN)
    wall = time.monotonic() - begun
    row |= {"run [% of a core]": 100 * (busy(run) - before) / wall}
    row |= {"server [% of a core]": 100 * (busy({os.getpid()}) - served) / wall}
    row |= {"late ticks": FRAME.unpack_from(binary(session.frame))[4] - late}
    if client:
        pipe.send(True)
        frames, size = pipe.recv()
        row |= {"frames [1/s]": frames / wall, "frame [kB]": 1e-3 * size / max(frames, 1)}
        pipe.send(False)
        process.join()
    return row


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--turns", type=int, default=4)
    given = options.parse_args()
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as folder:
        session = Session(find("kidney"), Path(folder), [])
        page = serve(session)
        address = page.address.replace("http", "ws", 1).replace("/?", "/frames?")
        try:
            while not session.frame:
                time.sleep(0.1)
            run = {child.pid for child in psutil.Process().children(recursive=True)}
            session.take(session, PRESSED)
            time.sleep(2.0)
            for _ in range(given.turns):
                rows += [
                    {"client": "none", **span(session, run, address, False)},
                    {"client": "one", **span(session, run, address, True)},
                ]
        finally:
            page.close()
    print_tables({f"Frames for renderers, spans of {SPAN:g} s": rows}, given.json, digits=3)


if __name__ == "__main__":
    main()
