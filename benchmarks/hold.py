"""Does a finger hold still? Every body in every graph that it fits, at several rates, under the shipped encoder.

    python benchmarks/hold.py [GRAPH ...] [--bodies MassSpring BeamBundle] [--rates 500 1000 5000]

Each run is the touch of the graph, fused, on simulated time. For each device it prints the peak of the force [N], and
over the last 0.2 s of the hold with the largest force: the mean force [N]; the noise [mN], RMS without any filter,
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
GRAPHS = {  # device: controller, friction
    **dict.fromkeys(("kidney", "fingertip", "nodule", "remote"), ONE),
    "organs": {"device": ("controller", "friction-kidney")},
    "pinch": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in ("thumb", "index")},
    "palpate-two": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in (1, 2)},
}
TISSUE = {"organs": ("kidney", "liver")}
SECONDS = 0.2


def holds(path) -> list[float]:
    """When the rests of at least `SECONDS` end [s]."""
    ends, now = [], 0.0
    for segment in path:
        now += segment.get("hold") or segment["time"]
        if (segment.get("hold") or 0.0) >= SECONDS:
            ends.append(now)
    return ends


def measure(record: Recording, controller: str, friction: str, ends: list[float], rate: float) -> str:
    force = record.columns(controller)["force"]
    count, best = round(SECONDS * rate), None
    for end in ends:
        part = force[: round(end * rate)][-count:]
        if best is None or np.linalg.norm(part.mean(axis=0)) > np.linalg.norm(best[0].mean(axis=0)):
            best = part, end
    if best is None:
        return "no hold"
    part, end = best
    t = np.vander(np.linspace(-1, 1, len(part)), 3)
    left = part - t @ np.linalg.lstsq(t, part, rcond=None)[0]
    noise = [1e3 * float(np.sqrt(np.square(x).sum(axis=1).mean())) for x in (part - part.mean(axis=0), left)]
    rub = (
        record.columns(friction)["force"][: round(end * rate)][-count:]
        if friction in record.streams
        else np.zeros((1, 3))
    )
    peak, mean = np.linalg.norm(force, axis=1).max(), np.linalg.norm(part.mean(axis=0))
    slip = float(np.linalg.norm(rub, axis=1).mean())
    return f"{peak:7.2f} {mean:7.2f} {noise[0]:9.1f} {noise[1]:9.2f} {slip:7.3f}"


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("graphs", nargs="*", default=list(GRAPHS))
    words.add_argument("--bodies", nargs="+", default=["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
    words.add_argument("--rates", nargs="+", type=int, default=[500, 1000, 5000])
    given = words.parse_args()
    print(f"{'graph, device':24s}{'body':12s}{'Hz':>6s}    peak    held  rms [mN] about parabola friction", flush=True)
    for graph, body, rate in product(given.graphs, given.bodies, given.rates):
        sets = [f"{name}.use=deformation.{body}" for name in TISSUE.get(graph, ("tissue",))]
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
            for device, (controller, friction) in fingers.items():
                row = measure(record, controller, friction, holds(nodes[device].settings["path"]), rate)
                print(f"{f'{graph}, {device}':24s}{body:12s}{rate:6d} {row}", flush=True)


if __name__ == "__main__":
    main()
