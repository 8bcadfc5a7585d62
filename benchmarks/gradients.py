"""Cost of derivatives and of fits, in processor time over that of one run.

    python benchmarks/gradients.py [--duration 1.8]

Prints for the kidney the cost of the derivatives by 1, 4 and 12 settings over that of one lane, the cost of those by
the 200 places of a map of stiffness, and the processor time of a fit of four settings to a press and a stroke, the
figures of docs/backwards.md. Takes two minutes.
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import numpy as np

import palpate
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.studies.inverse.fit import fit_run
from palpate.studies.inverse.measured import read_recording

IDEAL = ["scene.hand.ideal=true"]
SETTINGS = [
    "tissue.stiffness", "tissue.retardation", "contact.finger_stiffness", "contact.finger_hardening",
    "friction.mu_slide", "friction.mu_static", "friction.stribeck", "friction.viscous", "device.mass",
    "device.hand_stiffness", "scene.hand.path[1].to[2]", "scene.hand.path[1].time",
]  # fmt: skip
FREE = SETTINGS[:3] + ["friction.mu_slide"]
STROKE = (
    "[{to: [0, 0, 0.0975], time: 0.4}, {hold: 0.2}, {to: [0.02, 0, 0.0975], time: 0.6, shape: linear}, "
    "{to: [0.02, 0, 0.112], time: 0.4}]"
)


PLACES = 200
TOUCHES = {"press": 1.2, "press and stroke": 3.9, "whole touch": 5.8}  # [s]


def seconds(work) -> float:
    """Processor time [s] of a call, the second time."""
    work()
    begun = time.process_time()
    work()
    return time.process_time() - begun


def write_map(file: Path) -> np.ndarray:
    """A map of `PLACES` places all over the kidney, each as far from the others as possible. Returns its factors."""
    vertices = MassSpring(surface="kidney", position=(0.0, 0.0, 0.084), vertices=10000).mesh().vertices
    places, away = [0], np.full(len(vertices), np.inf)
    while len(places) < PLACES:
        away = np.minimum(away, np.linalg.norm(vertices - vertices[places[-1]], axis=1))
        places.append(int(away.argmax()))
    factors = np.exp(0.2 * np.random.default_rng(0).standard_normal(PLACES))
    rows = np.column_stack([vertices[places], factors])
    np.savetxt(file, rows, delimiter=",", header="x [m],y [m],z [m],factor", comments="")
    return factors


def by_places(folder: Path) -> None:
    """Print the cost of the derivatives by the places of a map."""
    factors = write_map(folder / "map.csv")
    sets = [*IDEAL, f"tissue.measured_map={folder / 'map.csv'}", f"tissue.map_factors={factors.tolist()}"]
    names = np.array([f"tissue.map_factors[{place}]" for place in range(PLACES)])
    for what, duration in TOUCHES.items():
        several = palpate.Ensemble("kidney", 64, sets=sets, duration=duration, threads=1)
        one = seconds(lambda run=several: run.run(quiet=True)) / 64
        alone = seconds(lambda d=duration: palpate.run("kidney", duration=d, record=None, sets=sets))
        touch = palpate.Ensemble("kidney", 1, sets=sets, duration=duration, threads=1)
        took = seconds(lambda run=touch: run.gradient(names, quiet=True))
        found = np.nan_to_num(touch.gradient(names, quiet=True)["contact.force.derivative"].values[0])
        felt = (found != 0.0).any(axis=1)
        each = seconds(lambda run=touch, by=names[felt]: run.gradient(by, quiet=True)) / felt.sum()
        largest = np.sqrt(np.mean(found**2, axis=1)).max()
        at_once = int((np.abs(found) > 1e-4 * largest).sum(axis=0).max())
        print(
            f"{PLACES} places, {what}, {duration:g} s: {felt.sum()} have an effect, {at_once} at one time; "
            f"{took:.2f} s, {took / one:.0f} x one lane, {took / alone:.1f} x palpate.run; "
            f"with lanes for all {PLACES * each / took:.0f} x"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=1.8)
    given = parser.parse_args()
    warnings.simplefilter("ignore", palpate.PalpateWarning)
    touches = palpate.Ensemble("kidney", 64, sets=IDEAL, duration=given.duration, threads=1)
    one = seconds(lambda: touches.run(quiet=True)) / 64
    print(f"one lane of {given.duration:g} s: {1e3 * one:.1f} ms of processor time")
    touch = palpate.Ensemble("kidney", 1, sets=IDEAL, duration=given.duration, threads=1)
    for count in (1, 4, 12):
        took = seconds(lambda by=SETTINGS[:count]: touch.gradient(by, quiet=True))
        print(f"derivatives by {count} settings: {6 * count + 1} lanes, {took / one:.1f} x one lane")
    with tempfile.TemporaryDirectory() as folder:
        by_places(Path(folder))
        file, sets = Path(folder) / "stroke.mcap", ["scene.hand.begin=[0, 0, 0.112]", f"scene.hand.path={STROKE}"]
        palpate.run(
            "kidney", record=file, duration=1.6, sets=[*sets, "tissue.stiffness=180", "tissue.retardation=0.035"]
        )
        measured = read_recording(file, ["contact.force", "friction.force"], "kidney", None, [], None)
        fit = fit_run([measured], FREE)
        took = seconds(lambda: fit_run([measured], FREE))
    print(f"fit of {len(FREE)} settings to {measured.ticks} ticks: {took:.2f} s of processor time, {fit.runs} runs")


if __name__ == "__main__":
    main()
