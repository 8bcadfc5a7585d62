"""Force noise while a finger holds still, for every body in every graph that accepts it, at several rates.

    python benchmarks/hold.py [GRAPH ...] [--bodies MassSpring BeamBundle] [--rates 500 1000 5000] [--exact]

Each run is the touch of the graph with the shipped encoder, fused, on simulated time; `--exact` replaces the encoder by
exact positions. Printed for each device: the peak force [N] and, over the last 0.2 s (at most half) of the hold with
the largest force, the mean force [N], the unfiltered RMS noise [mN] about the mean and about a fitted parabola, which
removes the creep of relaxing bodies, and the friction [N].
"""

import argparse
import tempfile
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.physics.errors import PalpateError, RunError
from palpate.records.reader import Recording

ONE = {"device": ("controller", "friction")}
GRAPHS = {  # device: controller, frictions
    **dict.fromkeys(("kidney", "fingertip", "nodule", "remote", "texture"), ONE),
    "organs": {"device": ("controller", "friction-kidney", "friction-liver")},
    "pinch": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in ("thumb", "index")},
    "palpate-two": {f"device-{f}": (f"controller-{f}", f"friction-{f}") for f in (1, 2)},
}
NETWORK = 40e-3  # [s] of the graph remote, there and back
TISSUE = {"organs": ("kidney", "liver")}
EXACT = {  # nodes with a setting for the encoder's resolution
    "pinch": [f"{node}{f}" for f in ("thumb", "index") for node in ("device-", "", "controller-")],
    "palpate-two": [f"{node}-{f}" for f in (1, 2) for node in ("device", "finger", "controller")],
}
SECONDS = 0.2


def holds(path) -> list[tuple[float, float]]:
    """Begin and end [s] of the measured part of each hold."""
    parts, now = [], 0.0
    for segment in path:
        rest = segment.get("hold") or 0.0
        now += rest or segment["time"]
        if rest >= SECONDS:
            parts.append((now - min(SECONDS, 0.5 * rest), now))
    return parts


class Hold(NamedTuple):
    """Forces [N] of a device: peak; during the hold: mean, noise about it and about a parabola, friction."""

    peak: float
    held: float
    noise: float
    about_parabola: float
    friction: float


def measure(record: Recording, controller: str, frictions: list[str], parts: list[tuple[float, float]], rate: float):
    """The figures of the hold with the largest force."""
    force = record.columns(controller)["force"]
    windows = [slice(a, b) for a, b in (np.round(np.array(parts) * rate).astype(int)) if b <= len(force)]
    window = max(windows, key=lambda each: np.linalg.norm(force[each].mean(axis=0)))
    held = force[window]
    t = np.vander(np.linspace(-1, 1, len(held)), 3)
    left = held - t @ np.linalg.lstsq(t, held, rcond=None)[0]
    noise = [float(np.sqrt(np.square(each).sum(axis=1).mean())) for each in (held - held.mean(axis=0), left)]
    rubs = [record.columns(friction)["force"][window] for friction in frictions if friction in record.streams]
    rub = np.linalg.norm(sum(rubs, np.zeros((1, 3))), axis=1).mean()
    return Hold(np.linalg.norm(force, axis=1).max(), np.linalg.norm(held.mean(axis=0)), *noise, float(rub))


def run(graph: str, body: str, rate: int, exact: bool = False) -> dict[str, Hold]:
    """The figures of each device of a graph with a given body at a rate [Hz]."""
    sets = [f"rate={rate}", *(f"{name}.use=deformation.{body}" for name in TISSUE.get(graph, ("tissue",)))]
    if graph == "remote":
        sets.append(f"controller.delay={round(NETWORK * rate)}")
    if exact:
        sets += [f"{name}.resolution=0" for name in EXACT.get(graph, ("device", "finger", "controller"))]
    fingers = GRAPHS[graph]
    wanted = tuple(stream for streams in fingers.values() for stream in streams)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hold.mcap"
        launch = find(graph).but(record=file, overrides=sets, place="fused", wanted=wanted)
        nodes = launch.load().nodes
        result = execute(launch).result
        if not result.ok:
            raise RunError(f"failed: {result.deaths or result.notes}")
        record = Recording(file)
        return {
            device: measure(record, controller, frictions, holds(nodes[device].settings["path"]), rate)
            for device, (controller, *frictions) in fingers.items()
        }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("graphs", nargs="*", default=list(GRAPHS))
    parser.add_argument("--bodies", nargs="+", default=["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
    parser.add_argument("--rates", nargs="+", type=int, default=[500, 1000, 5000])
    parser.add_argument("--exact", action="store_true")
    given = parser.parse_args()
    print(f"{'graph, device':24s}{'body':12s}{'Hz':>6s}    peak    held  rms [mN] about parabola friction", flush=True)
    for graph, body, rate in product(given.graphs, given.bodies, given.rates):
        try:
            found = run(graph, body, rate, given.exact)
        except PalpateError as error:
            print(f"{graph:24s}{body:12s}{rate:6d} {str(error).splitlines()[0]}", flush=True)
            continue
        for device, (peak, held, noise, about, rub) in found.items():
            figures = f"{peak:7.2f} {held:7.2f} {1e3 * noise:9.1f} {1e3 * about:9.2f} {rub:7.3f}"
            print(f"{f'{graph}, {device}':24s}{body:12s}{rate:6d} {figures}", flush=True)


if __name__ == "__main__":
    main()
