"""A hold on tissue that is stiffer than the device renders, where few ticks or exact positions show its slope badly."""

import numpy as np
import pytest

import palpate
from palpate.nodes.controller import Haptic

EXACT = ("scene.hand.ideal=true",)
FINE = ("device.resolution=2.12e-4", "finger.resolution=2e-5", "controller.resolution=2e-5")  # a third of a Falcon's
STIFF = "tissue.stiffness=4000"
CASES = [  # rate [Hz], delay [1], hand [kg], [N/m], [N s/m], its target [m], settings
    (250, 3, 0.12, 1100.0, 1.7, 0.0996, ("tissue.stiffness=1200", *EXACT)),
    (250, 1, 0.12, 3000.0, 7.0, 0.0962, (STIFF, *EXACT)),
    (250, 1, 0.18, 870.0, 11.6, 0.0956, ("tissue.stiffness=3200", *FINE)),
    (250, 3, 0.38, 1300.0, 17.7, 0.096, ("tissue.use=deformation.ReducedFE", "tissue.young=400000", *EXACT)),
    (1000, 3, 0.31, 460.0, 14.2, 0.0961, ("tissue.use=deformation.Rigid", *EXACT)),
]


def run(rate, delay, hand, duration, sets):
    """Force on the hand [N] (T,3), and the energy [J] (T) that the display has absorbed."""
    given = [f"rate={rate}", f"device.delay={delay}", f"controller.delay={delay}", "scene.surface.vertices=2000", *sets]
    given += [f"scene.hand.{name}={value}" for name, value in hand.items()]
    wanted = ["controller.force", "controller.energy"]
    found = palpate.Ensemble("kidney", 1, {}, wanted, duration=duration, sets=given).run(quiet=True)
    return [np.asarray(found[name])[0] for name in wanted]


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")  # notes that the contact is stiffer than the display
@pytest.mark.parametrize(("rate", "delay", "mass", "stiffness", "damping", "z", "sets"), CASES)
def test_the_hand_comes_to_rest_and_gains_no_energy(rate, delay, mass, stiffness, damping, z, sets):
    hand = {"mass": mass, "hand_stiffness": stiffness, "hand_damping": damping,
            "path": f"[{{to: [0, 0, {z}], time: 0.3}}, {{hold: 1}}]"}  # fmt: skip
    force, energy = run(rate, delay, hand, 1.2, sets)
    held = force[round(0.8 * rate) :]
    assert 0.1 < np.linalg.norm(held.mean(axis=0)) < Haptic.limit
    assert np.sqrt(np.square(held - held.mean(axis=0)).sum(axis=1).mean()) < 0.02
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.5
    assert energy.min() > -1e-3


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
@pytest.mark.parametrize(("rate", "delay"), [(250, 0), (250, 1), (1000, 2)])
@pytest.mark.parametrize("body", ["tissue.use=deformation.Rigid", "tissue.stiffness=2000"])
def test_the_work_of_friction_does_not_pay_for_an_oscillation(rate, delay, body):
    slide = "{to: [0.03, 0, 0.1], time: 0.8}, {to: [0, 0, 0.1], time: 0.4}, {hold: 1}"
    hand = {"path": f"[{{to: [-0.03, 0, 0.102], time: 0.3}}, {slide}]"}
    force, energy = run(rate, delay, hand, 2.5, [body, *EXACT])
    held = force[round(1.9 * rate) :]
    assert energy[-1] > 10e-3 and np.linalg.norm(held.mean(axis=0)) > 0.1
    assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.5
    assert np.sqrt(np.square(held - held.mean(axis=0)).sum(axis=1).mean()) < 0.02
