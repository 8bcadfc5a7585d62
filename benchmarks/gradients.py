"""Cost of derivatives and of fits, in processor time over that of one run.

    python benchmarks/gradients.py [--duration 1.8]

Prints for the kidney the cost of the derivatives by 1, 4 and 12 settings over that of one lane, and the processor time
of a fit of four settings to a press and a stroke, the figures of docs/backwards.md. Takes a minute.
"""

import argparse
import tempfile
import time
import warnings
from pathlib import Path

import palpate
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


def seconds(work) -> float:
    """Processor time [s] of a call, the second time."""
    work()
    begun = time.process_time()
    work()
    return time.process_time() - begun


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
