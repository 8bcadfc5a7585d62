"""Does a finger hold still? Every body in every graph that it fits, at several rates, under the shipped encoder.

    python benchmarks/hold.py [GRAPH ...] [--bodies MassSpring Rigid] [--rates 500 1000 5000] [--exact] [--no-apart]
    python benchmarks/hold.py --search 300 [--seed 1]

Prints the table of docs/stability.md, a row for each graph and body and in each cell a figure for each rate. A run is
the touch of the graph on simulated time, fused; `--exact`: with exact positions in place of the encoder's. Figures are
the largest over all devices: the peak of the force [N], and in the hold with the largest force, over its last 0.2 s but
at most its second half, the mean force [N], the unfiltered RMS noise about the mean [mN], and the friction [N]. `apart`
is the largest difference [N] of the force on the hand in a run with one process per node, which ends 0.2 s after
contact begins. If a combination is refused, its cell shows the reason. If its forces are not valid, its row has a mark,
and a warning follows the table. Takes 15 minutes on two cores.

`--search`: random closed loops of the graph kidney, an ensemble for each body, law of friction and rate (250 Hz to 10
kHz), whose lanes differ in mass, stiffness and damping of the hand, delay of the device, of which the controller knows,
place, depth and time of the press. Printed are the loops with more than 30 mN of noise by law and by body, the worst
ten, and how many of them `palpate check` reports (launch/load/resting.py).
"""

import argparse
import os
import shlex
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np

import palpate
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
EXACT = {  # nodes with a setting for the encoder
    "pinch": [f"{node}{f}" for f in ("thumb", "index") for node in ("device-", "", "controller-")],
    "palpate-two": [f"{node}-{f}" for f in (1, 2) for node in ("device", "finger", "controller")],
}
SECONDS = 0.2
APART = 0.2  # [s] of contact in a run with one process per node
BODIES = ("MassSpring", "BeamBundle", "ReducedFE", "Rigid")
INVALID = "meaningless"  # in the note of a contact whose forces are not valid


def holds(path) -> list[tuple[float, float]]:
    """Begin and end [s] of the measured part of each rest."""
    parts, now = [], 0.0
    for segment in path:
        rest = segment.get("hold") or 0.0
        now += rest or segment["time"]
        if rest >= SECONDS:
            parts.append((now - min(SECONDS, 0.5 * rest), now))
    return parts


class Hold(NamedTuple):
    """Forces [N] of a device: its peak, and of the hold the mean, the noise about it, and friction."""

    peak: float
    held: float
    noise: float
    friction: float


def measure(record: Recording, controller: str, frictions: list[str], parts: list[tuple[float, float]], rate: float):
    """Figures of the hold with the largest force."""
    force = record.columns(controller)["force"]
    windows = [slice(a, b) for a, b in (np.round(np.array(parts) * rate).astype(int)) if b <= len(force)]
    window = max(windows, key=lambda each: np.linalg.norm(force[each].mean(axis=0)))
    held = force[window].mean(axis=0)
    noise = float(np.sqrt(np.square(force[window] - held).sum(axis=1).mean()))
    rubs = [record.columns(friction)["force"][window] for friction in frictions if friction in record.streams]
    rub = np.linalg.norm(sum(rubs, np.zeros((1, 3))), axis=1).mean()
    return Hold(np.linalg.norm(force, axis=1).max(), np.linalg.norm(held), noise, float(rub))


class MeasuredRun(NamedTuple):
    """Figures of each device, force difference [N] to one process per node, and warnings of invalid forces."""

    holds: dict[str, Hold]
    apart: float
    notes: list[str]


def run(graph: str, body: str, rate: int, exact: bool = False, apart: bool = False) -> MeasuredRun:
    """Each device of a graph with a body in it at a rate [Hz]."""
    sets = [f"rate={rate}", *(f"{name}.use=deformation.{body}" for name in TISSUE.get(graph, ("tissue",)))]
    if graph == "remote":
        sets.append(f"controller.delay={round(NETWORK * rate)}")
    if exact:
        sets += [f"{name}.resolution=0" for name in EXACT.get(graph, ("device", "finger", "controller"))]
    fingers = GRAPHS[graph]
    wanted = tuple(stream for streams in fingers.values() for stream in streams)
    with tempfile.TemporaryDirectory() as folder:

        def record(place: str, duration: float | None = None) -> tuple[Recording, tuple[str, ...]]:
            file = Path(folder) / f"{place}.mcap"
            given = {"duration": duration} if duration else {}
            result = execute(launch.but(record=file, place=place, **given)).result
            if not result.ok:
                raise RunError(
                    "; ".join(f"{death.node}: {death.text}" for death in result.deaths[:1]) or str(result.notes)
                )
            return Recording(file), tuple(result.notes)

        launch = find(graph).but(overrides=sets, wanted=wanted)
        nodes = launch.load().nodes
        whole, notes = record("fused")
        holds_ = {
            device: measure(whole, controller, frictions, holds(nodes[device].settings["path"]), rate)
            for device, (controller, *frictions) in fingers.items()
        }
        difference = float("nan")
        if apart:
            forces = {controller: whole.columns(controller)["force"] for controller, *_ in fingers.values()}
            begin = min(int(np.argmax(force.any(axis=1))) for force in forces.values()) / rate
            other, _ = record("apart", begin + APART)
            parts = [(other.columns(name)["force"], force) for name, force in forces.items()]
            difference = max(float(np.abs(short - long[: len(short)]).max()) for short, long in parts)
        return MeasuredRun(holds_, difference, [note for note in notes if INVALID in note])


def row(graph: str, body: str, rates: list[int], exact: bool, apart: bool) -> tuple[str, list[str]]:
    """A row of the table, and the warnings."""
    cells: list[list[str]] = [[] for _ in Hold._fields]
    most, notes = 0.0, []
    for rate in rates:
        try:
            found = run(graph, body, rate, exact, apart)
        except PalpateError as error:
            what = "failed" if isinstance(error, RunError) else "refused"
            cells[0].append(f"{what} at {rate} Hz: {str(error).splitlines()[0]}")
            continue
        most, notes = max(most, found.apart), found.notes or notes
        for cell, form, scale, values in zip(
            cells, ("{:.2f}", "{:.2f}", "{:.1f}", "{:.2f}"), (1, 1, 1e3, 1), zip(*found.holds.values(), strict=True),
            strict=True,
        ):  # fmt: skip
            cell.append(form.format(scale * max(values)))
    if notes:
        cells[-1] = ["(contact beyond its law)"]
    words = [*(", ".join(cell) for cell in cells), f"{most:.2g}" if apart else ""]
    return "| " + " | ".join([f"`{graph}`", f"`{body}`", *words]) + " |", notes


LAWS, RATES, NOISY = ("LuGre", "Coulomb", "ElastoPlastic"), (250, 1000, 4000, 10000), 30e-3  # [Hz], [N]
FOUND = 1.0  # [s] measured, at the end of the hold


class Loop(NamedTuple):
    """Noise [N] (RMS) of a closed loop, whether `palpate check` reports it, and its settings as `--set` takes them."""

    noise: float
    reported: bool
    sets: str


def search(count: int, seed: int) -> list[Loop]:
    """Random closed loops."""
    rng = np.random.default_rng(seed)
    kinds = list(product(("MassSpring", "BeamBundle", "ReducedFE"), LAWS, RATES))
    found = []
    for kind, lanes in zip(*np.unique(rng.integers(len(kinds), size=count), return_counts=True), strict=True):
        (body, law, rate), lanes = kinds[kind], int(lanes)

        def spread(least: float, most: float, lanes: int = lanes) -> list[float]:
            """Log-uniform."""
            return [float(f"{x:.4g}") for x in np.exp(rng.uniform(np.log(least), np.log(most), lanes))]

        place = np.round(rng.uniform((-0.01, -0.01, 0.092), (0.01, 0.01, 0.1), (lanes, 3)), 5).tolist()
        delay = rng.integers(0, max(1, round(2.5e-3 * rate)), lanes, endpoint=True).tolist()
        over = {
            "scene.hand.mass": spread(0.05, 0.4), "scene.hand.hand_stiffness": spread(100, 1000),
            "scene.hand.hand_damping": spread(1, 20), "device.delay": delay, "controller.delay": delay,
            "scene.hand.path": [[{"to": to, "time": time_}, {"hold": 2}]
                                for to, time_ in zip(place, spread(0.1, 0.8), strict=True)],
        }  # fmt: skip
        sets = [f"rate={rate}", f"tissue.use=deformation.{body}", f"friction.use=friction.{law}"]
        ensemble = palpate.Ensemble("kidney", lanes, over, ["controller.force"], duration=2.8, sets=sets)
        force = np.asarray(ensemble.run(quiet=True)["controller.force"])[:, -round(FOUND * rate) :]
        noise = np.sqrt(np.square(force - force.mean(axis=1, keepdims=True)).sum(axis=2).mean(axis=1))
        for lane in range(lanes):
            given = [*sets, *(f"{name}={str(values[lane]).replace(chr(39), '')}" for name, values in over.items())]
            reported = any("come to rest" in note for note in find("kidney").but(overrides=tuple(given)).load().notes)
            found.append(Loop(float(noise[lane]), reported, " ".join(f"--set {shlex.quote(each)}" for each in given)))
    return found


def print_search(count: int, seed: int) -> None:
    """Run the search and print its result."""
    begin = time.process_time()
    found = search(count, seed)
    print(f"{count} loops in {time.process_time() - begin:.0f} s of processor time; above {1e3 * NOISY:g} mN:")
    for name in (*(f"friction.{law}" for law in LAWS), *(f"deformation.{body}" for body in BODIES[:3])):
        noises = [loop.noise for loop in found if f".use={name}" in loop.sets]
        if noises:
            over = sum(noise > NOISY for noise in noises)
            print(f"  {name}: {over} of {len(noises)}, worst {1e3 * max(noises):.0f} mN")
    noisy = [loop for loop in found if loop.noise > NOISY]
    missed = [loop.noise for loop in noisy if not loop.reported]
    print(
        f"  check reports {len(noisy) - len(missed)} of {len(noisy)} (the others: at most "
        f"{1e3 * max(missed, default=0.0):.0f} mN), and {sum(loop.reported for loop in found if loop not in noisy)} of "
        f"{count - len(noisy)} that rest"
    )
    for loop in sorted(found, reverse=True)[:10]:
        print(f"{1e3 * loop.noise:.0f} mN: palpate run kidney --duration '2.8 s' {loop.sets}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("graphs", nargs="*", default=list(GRAPHS))
    parser.add_argument("--bodies", nargs="+", default=list(BODIES))
    parser.add_argument("--rates", nargs="+", type=int, default=[500, 1000, 5000])
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--no-apart", action="store_true")
    parser.add_argument("--search", type=int, metavar="LOOPS")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.search:
        print_search(given.search, given.seed)
        return
    pairs, begin, warned = list(product(given.graphs, given.bodies)), time.monotonic(), []
    print("| graph | body | peak force [N] | held force [N] | noise [mN] | held friction [N] | apart [N] |")
    print("|---|---|---|---|---|---|---|", flush=True)
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        tasks = [pool.submit(row, *pair, given.rates, given.exact, not given.no_apart) for pair in pairs]
        for k, (pair, task) in enumerate(zip(pairs, tasks, strict=True), 1):
            line, notes = task.result()
            print(line, flush=True)
            warned += [f"{', '.join(pair)}: {note}" for note in notes]
            print(f"{k} of {len(pairs)}, {time.monotonic() - begin:.0f} s", file=sys.stderr, flush=True)
    print("", *warned, sep="\n")


if __name__ == "__main__":
    main()
