"""The fingertip of beams and the finite-element fingertip next to presses of four people, with one force scale free.

    python benchmarks/measured/fingertips.py FOLDER [-o fingertips.png]

Reads finger_F1.csv to finger_F4.csv: press, travel [mm], force [N]. The indenter was a ball of unknown radius and the
models press on a flat plate, so each person has a free factor of the force and each press a free touch point; the shape
of the curve is compared. The exponential law, with one hardening fitted to all, is the lower bound of the residual.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from source import parser, presses_of_people

import palpate.nodes.tactile.flow as flow
from palpate.launch.testing import FakeBus
from palpate.messages import Contact
from palpate.models.fit.finger import FingerPress, fit_fingers
from palpate.nodes.fingertip import BundleContact, Slide
from palpate.views.pictures import style

SLOW, DEEP, STEPS = 0.5e-3, 2.4e-3, 400.0
"""Speed [m/s] and depth [m] of the press of the beams, at this rate [Hz]."""


class Curve(NamedTuple):
    """Force [N] (n) over depth [m] (n) of a model."""

    depth: np.ndarray
    force: np.ndarray


def beams() -> Curve:
    """The bundle of beams, flat on the plate."""
    hand = Slide(press=SLOW, depth=DEEP, distance=0.0)
    hand.start()
    finger = FakeBus(BundleContact(angle=0.0), rate=STEPS)
    depth, force = [], []
    for _ in range(round(DEEP / SLOW * STEPS)):
        pose = hand.step(dt=1.0 / STEPS)
        sent = finger.publish(pose)[0]
        depth.append(hand.thickness + hand.plate - pose.position[2])
        force.append(next(message for message in sent if isinstance(message, Contact)).force)
    return Curve(np.array(depth), np.array(force))


def elements() -> Curve:
    """The layered finite-element fingertip with its calibrated materials, on steel, from the shipped table."""
    with np.load(flow.TABLE) as found:
        return Curve(found["steel.indentation"], found["steel.force"])


def scaled(curve: Curve, people: list[list[FingerPress]]) -> tuple[np.ndarray, float, np.ndarray]:
    """Factor of the force of each person, RMS residual [N], touch point of each press [m]."""
    presses = [(i, press) for i, each in enumerate(people) for press in each]

    def model(s: np.ndarray) -> np.ndarray:
        """The curve; beyond its end with the slope there."""
        end = curve.depth[-1]
        slope = (curve.force[-1] - curve.force[-4]) / (end - curve.depth[-4])
        return np.interp(s, curve.depth, curve.force) + slope * np.maximum(s - end, 0.0)

    def residuals(x: np.ndarray) -> np.ndarray:
        out = []
        for k, (i, press) in enumerate(presses):
            depth = np.maximum(press.travel - 1e-3 * x[len(people) + k], 0.0)
            out.append((math.exp(x[i]) * model(depth) - press.force) / math.sqrt(len(depth)))
        return np.concatenate(out)

    best = None
    for share in (0.02, 0.1, 0.25):
        touch = [1e3 * press.travel[np.argmax(press.force > share * press.force[-1])] for _, press in presses]
        found = least_squares(residuals, [*np.zeros(len(people)), *(t - 0.3 for t in touch)])
        best = found if best is None or found.cost < best.cost else best
    assert best is not None
    rms = math.sqrt(2.0 * best.cost / len(presses))
    return np.exp(best.x[: len(people)]), rms, 1e-3 * best.x[len(people) :]


def main() -> None:
    given = parser(__doc__).parse_args()
    people = presses_of_people(given.folder)
    fitted = fit_fingers(people)
    print(f"exponential law, one m of {fitted.hardening:.0f} 1/m: RMS {1e3 * fitted.residual:.0f} mN")
    drawn = []
    for name, curve in (("beams", beams()), ("finite elements", elements())):
        factor, rms, touch = scaled(curve, people)
        drawn.append((name, curve, factor, touch))
        at = ", ".join(f"{np.interp(d, curve.depth, curve.force):.3f}" for d in (0.5e-3, 1e-3, 1.5e-3, 2e-3))
        print(f"{name}: force at 0.5, 1, 1.5, 2 mm on a plate {at} N; factors of the people "
              + ", ".join(f"{x:.2f}" for x in factor) + f"; RMS {1e3 * rms:.0f} mN")  # fmt: skip
    if given.out:
        draw(given.out, drawn, people)


@style.look()
def draw(path, drawn, people) -> None:
    """Middle and spread of the presses, moved to the touch points of each model, over the factor of each person. No
    single row is shown, since the measurements have no licence."""
    figure = style.figure(
        13.0, 5.2, "Presses of four people next to two fingertips: one factor of the force per person"
    )
    edges = np.arange(-1.0, 2.5, 0.1)
    for axes, (name, curve, factor, touch) in zip(figure.subplots(1, 2, sharey=True), drawn, strict=True):
        presses = [(press, factor[i]) for i, each in enumerate(people) for press in each]
        depth = 1e3 * np.concatenate([press.travel - at for (press, _), at in zip(presses, touch, strict=True)])
        force = np.concatenate([press.force / size for press, size in presses])
        which = np.digitize(depth, edges)
        bins = [k for k in range(1, len(edges)) if np.count_nonzero(which == k) >= 20]
        low, middle, high = np.array([np.percentile(force[which == k], (10, 50, 90)) for k in bins]).T
        centres = edges[np.array(bins) - 1] + 0.05
        axes.fill_between(centres, low, high, color=style.FAINT, alpha=0.4, linewidth=0,
                          label="80 % of the rows, over their person's factor")  # fmt: skip
        axes.plot(centres, middle, color=style.FAINT, linewidth=2, label="their median")
        axes.plot(1e3 * curve.depth, curve.force, color=style.FINGER, linewidth=2, label=f"{name}, on a plate")
        axes.set(title=name, xlabel="depth [mm]", ylabel="force [N]", xlim=(-1.0, 2.4), ylim=(-0.02, None))
        axes.legend()
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
