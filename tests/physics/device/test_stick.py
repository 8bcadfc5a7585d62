"""The limit cycle of a finger that sticks: the describing function against a simulation in time, and against runs."""

import re

import numpy as np
import pytest
from pytest import approx

import palpate
from palpate.drivers.limits import LIMITS
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.launchfile import find
from palpate.physics.device.stick import HeldDevice, oscillation, resting_spring
from palpate.physics.friction.coulomb import Coulomb
from palpate.physics.friction.lugre import LuGre

LIGHT = HeldDevice(mass=0.3, arm=150.0, damping=1.7, delay=1.5e-3, step=60e-6)


def simulated(device: HeldDevice, spring: float, damper: float, seconds: float = 6.0, dt: float = 1e-4) -> float:
    """RMS [N] of the friction of a mass on its arm and on a spring with a damper behind a backlash and a delay, in the
    last second after a displacement of 2 mm."""
    late = max(1, round(device.delay / dt))
    x, v, y, past, felt = 2e-3, 0.0, 2e-3, [0.0] * late, []
    for k in range(round(seconds / dt)):
        before = y
        y = min(max(y, x - 0.5 * device.step), x + 0.5 * device.step)
        past.append(spring * y + damper * (y - before) / dt)
        force = past[k]
        v += dt * (-device.arm * x - device.damping * v - force) / device.mass
        x += dt * v
        felt.append(force)
    return float(np.std(felt[-round(1.0 / dt) :]))


@pytest.mark.parametrize("spring", [300.0, 500.0, 700.0])
@pytest.mark.parametrize("change", [{}, {"damping": 0.8}, {"delay": 3e-3, "damping": 3.0}, {"step": 20e-6}])
def test_the_describing_function_predicts_the_oscillation_of_a_simulation(spring, change):
    device = LIGHT._replace(**change)
    assert simulated(device, spring, 0.4) == approx(oscillation(device, spring, 0.4), rel=0.12)
    assert oscillation(device, spring, 0.4) > 0.0


@pytest.mark.parametrize("damping", [1.0, 2.0, 4.0])
def test_the_largest_resting_spring_separates_rest_from_oscillation(damping):
    device = LIGHT._replace(damping=damping)
    most = resting_spring(device, 1.0, 1e5)
    assert oscillation(device, 0.98 * most, 1.0) == 0.0 < oscillation(device, 1.03 * most, 1.0)
    assert simulated(device, 0.9 * most, 1.0) < 0.1 * oscillation(device, 1.15 * most, 1.0)
    assert simulated(device, 1.15 * most, 1.0) > 0.5 * oscillation(device, 1.15 * most, 1.0)


def test_without_a_count_only_the_delay_sustains_an_oscillation():
    """The damping -k t of a late spring against that of the hand (Colgate & Schenkel 1997)."""
    exact = LIGHT._replace(step=0.0)
    limit = exact.damping / exact.delay
    assert oscillation(exact, 0.99 * limit, 0.0) == 0.0 and oscillation(exact, 1.01 * limit, 0.0) == np.inf
    assert resting_spring(exact, 0.0, 1e5) == approx(limit, rel=0.02)


def test_coulombs_damper_replaces_the_damping_that_the_slowest_driver_takes_from_its_spring():
    slowest = max(each.delay for each in LIMITS.values()) * 1e-3
    assert Coulomb().damping == approx(Coulomb().stiffness * slowest)
    hertz = 302.0 * (2.7 / 0.6) ** (1.0 / 3.0)  # a fingertip at 0.6 N (Mindlin); its contact radius grows as F^(1/3)
    assert Coulomb().stiffness == approx(hertz, rel=0.02)


def test_stick_is_the_slope_of_a_law_for_small_motions():
    law, load, x, v = LuGre(), 0.8, 1e-9, 1e-9
    spring, damper = LuGre.stick(law, load)
    _, force, _ = LuGre.advance(law, (x, 0.0, 0.0), (v, 0.0, 0.0), load, 1e-6, 0.0)
    assert force[0] == approx(spring * x + damper * v, rel=1e-3)


SETS = ["friction.use=friction.Coulomb", "scene.hand.mass=0.33", "scene.hand.hand_stiffness=105",
        "scene.hand.hand_damping=1.5", "device.delay=2", "controller.delay=2",
        "scene.hand.path=[{to: [-0.002, 0.006, 0.0935], time: 0.3}, {hold: 2.5}]"]  # fmt: skip


def held(*sets: str) -> float:
    """RMS noise [N] of the force on the hand in the last second."""
    run = palpate.Ensemble("kidney", 1, keep=["controller.force"], duration=2.8, sets=[*SETS, *sets])
    force = np.asarray(run.run(quiet=True)["controller.force"])[0, -1000:]
    return float(np.sqrt(np.square(force - force.mean(axis=0)).sum(axis=1).mean()))


@pytest.mark.filterwarnings("ignore::palpate.PalpateWarning")
def test_check_names_a_finger_that_does_not_rest_and_its_remedy_works():
    notes = [note for note in find("kidney").but(overrides=tuple(SETS)).load().notes if "come to rest" in note]
    assert len(notes) == 1
    predicted = float(re.search(r"by ([\d.]+) mN \(RMS\)", notes[0])[1]) * 1e-3
    before = held()
    assert 0.4 * predicted < before < 2.5 * predicted
    after = held(re.search(r"--set (friction.stiffness=\d+)", notes[0])[1])
    assert after < 30e-3 and after < 0.4 * before


@pytest.mark.parametrize("path", sorted(GRAPHS.glob("*.yaml")), ids=lambda path: path.stem)
def test_fingers_of_the_shipped_graphs_rest(path):
    assert not [note for note in find(str(path)).load().notes if "come to rest" in note]
