"""Does a finger hold still? Every body in every graph that it fits, at several rates, under the shipped encoder.

    python benchmarks/hold.py [GRAPH ...] [--bodies MassSpring BeamBundle] [--rates 500 1000 5000] [--exact]

Each run is the touch of the graph, fused, on simulated time; `--exact`: with exact positions in place of the encoder's.
For each device it prints the peak of the force [N], and over the last 0.2 s, at most half, of the hold with the largest
force: the mean force [N]; the noise [mN], RMS without any filter,
about the mean and about a fitted parabola, which removes the slow creep of relaxing bodies; friction [N].
"""

import argparse
import tempfile
from itertools import product
from pathlib import Path

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.physics.errors import PalpateError
from palpate.records.reader import Recording

ONE = {"device": ("controller", "friction")}
GRAPHS = {  # device: controller, frictions
    **dict.fromkeys(("kidney", "fingertip", "nodule", "remote"), ONE),
    "organs": {"device": ("controller", "friction-kidney", "friction-liver")},
    "pinch": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in ("thumb", "index")},
    "palpate-two": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in (1, 2)},
}
NETWORK = 40e-3  # [s] of the graph remote, there and back
TISSUE = {"organs": ("kidney", "liver")}
EXACT = {  # what knows of the encoder
    "pinch": [f"{node}{f}" for f in ("thumb", "index") for node in ("device-", "", "controller-")],
    "palpate-two": [f"{node}-{f}" for f in (1, 2) for node in ("device", "finger", "controller")],
}
SECONDS = 0.2


def holds(path) -> list[tuple[float, float]]:
    """When the part of each rest that is measured begins and ends [s]."""
    parts, now = [], 0.0
    for segment in path:
        rest = segment.get("hold") or 0.0
        now += rest or segment["time"]
        if rest >= SECONDS:
            parts.append((now - min(SECONDS, 0.5 * rest), now))
    return parts


def measure(record: Recording, controller: str, frictions: list[str], parts: list[tuple[float, float]], rate: float):
    """The figures of a run as a line of the table."""
    force, best = record.columns(controller)["force"], None
    for begin, end in parts:
        part = force[round(begin * rate) : round(end * rate)]
        if best is None or np.linalg.norm(part.mean(axis=0)) > np.linalg.norm(best[0].mean(axis=0)):
            best = part, slice(round(begin * rate), round(end * rate))
    if best is None:
        return "no hold"
    part, window = best
    t = np.vander(np.linspace(-1, 1, len(part)), 3)
    left = part - t @ np.linalg.lstsq(t, part, rcond=None)[0]
    noise = [1e3 * float(np.sqrt(np.square(x).sum(axis=1).mean())) for x in (part - part.mean(axis=0), left)]
    rubs = [record.columns(friction)["force"][window] for friction in frictions if friction in record.streams]
    rub = sum(rubs, np.zeros((1, 3)))
    peak, mean = np.linalg.norm(force, axis=1).max(), np.linalg.norm(part.mean(axis=0))
    slip = float(np.linalg.norm(rub, axis=1).mean())
    return f"{peak:7.2f} {mean:7.2f} {noise[0]:9.1f} {noise[1]:9.2f} {slip:7.3f}"


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("graphs", nargs="*", default=list(GRAPHS))
    words.add_argument("--bodies", nargs="+", default=["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
    words.add_argument("--rates", nargs="+", type=int, default=[500, 1000, 5000])
    words.add_argument("--exact", action="store_true")
    given = words.parse_args()
    print(f"{'graph, device':24s}{'body':12s}{'Hz':>6s}    peak    held  rms [mN] about parabola friction", flush=True)
    for graph, body, rate in product(given.graphs, given.bodies, given.rates):
        sets = [f"{name}.use=deformation.{body}" for name in TISSUE.get(graph, ("tissue",))]
        if graph == "remote":
            sets.append(f"controller.delay={round(NETWORK * rate)}")
        if given.exact:
            sets += [f"{name}.resolution=0" for name in EXACT.get(graph, ("device", "finger", "controller"))]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "hold.mcap"
            fingers = GRAPHS[graph]
            wanted = tuple(stream for pair in fingers.values() for stream in pair)
            try:
                launch = find(graph).but(record=file, overrides=(f"rate={rate}", *sets), place="fused", wanted=wanted)
                nodes = launch.load().nodes
                result = execute(launch).result
            except PalpateError as error:
                print(f"{graph:24s}{body:12s}{rate:6d} refused: {str(error).splitlines()[0]}", flush=True)
                continue
            if not result.ok:
                print(f"{graph:24s}{body:12s}{rate:6d} failed: {result.failures}", flush=True)
                continue
            record = Recording(file)
            for device, (controller, *frictions) in fingers.items():
                row = measure(record, controller, frictions, holds(nodes[device].settings["path"]), rate)
                print(f"{f'{graph}, {device}':24s}{body:12s}{rate:6d} {row}", flush=True)


if __name__ == "__main__":
    main()
