"""Coulomb's law with a damped stick keeps its limit and creates no energy; a finger that does not rest is noticed."""

import numpy as np
import pytest
from expected_notes import UNTAKEN
from pytest import approx

import palpate
from palpate.compiler.fields import blank_record
from palpate.physics.friction.bristle import NOTHING
from palpate.physics.friction.coulomb import Coulomb, coulomb
from palpate.physics.friction.unrest import LIMIT, LONG, UNREST, WINDOW, watch

LIGHT = ["scene.hand.hand_damping=1", "scene.hand.mass=0.05", "device.delay=1", "controller.delay=1",
         "scene.hand.path=[{hold: 0.2}, {to: [0, 0, 0.0935], time: 0.5}, {hold: 2}]"]  # fmt: skip
UNDAMPED = ["friction.damping=0", "friction.stiffness=1500"]


def moved(law, velocities, loads, dt):
    """Forces [N] (t,3) and deflections [m] (t + 1,3)."""
    z, forces, bent = NOTHING, [], [NOTHING]
    for v, load in zip(velocities, loads, strict=True):
        z, force, _ = coulomb(law, z, tuple(v), load, dt, 0.0)
        forces.append(force)
        bent.append(z)
    return np.array(forces), np.array(bent)


@pytest.mark.parametrize("damping", [0.0, 0.3, 1.5, 20.0])
@pytest.mark.parametrize("dt", [1e-4, 1e-3, 0.1])
def test_no_force_exceeds_the_cone_and_no_step_creates_energy(damping, dt):
    law, rng = Coulomb(damping=damping), np.random.default_rng(int(1e4 * dt + 10 * damping))
    velocities = np.cumsum(rng.normal(0.0, 0.02, (400, 3)), axis=0) * [1.0, 1.0, 0.0]
    loads = rng.uniform(0.01, 3.0, 400)
    forces, bent = moved(law, velocities, loads, dt)
    assert (np.linalg.norm(forces, axis=1) <= law.mu * loads * (1.0 + 1e-12)).all()
    stored = 0.5 * law.stiffness * (bent**2).sum(axis=1)
    assert (np.einsum("ij,ij->i", forces, velocities) * dt >= np.diff(stored) - 1e-15).all()


@pytest.mark.parametrize("damping", [0.0, 1.5])
def test_a_slide_has_the_force_mu_times_the_load_along_its_direction(damping):
    forces, _ = moved(Coulomb(damping=damping), np.tile([0.03, -0.04, 0.0], (200, 1)), np.full(200, 2.0), 1e-3)
    assert forces[-1] == approx([0.6, -0.8, 0.0], abs=1e-12)


def test_the_stick_is_a_kelvin_voigt_solid():
    """Creep of z under a small constant force follows from the exact solution: z = f/k (1 - exp(-k t/d))."""
    law, dt, z, f = Coulomb(stiffness=400.0, damping=8.0), 1e-5, 0.0, 0.1
    for _ in range(4000):  # 2 k t/d = 4: find the motion with this force by inverting one step
        v = (f - law.stiffness * z) / (law.stiffness * dt + law.damping)
        (z, *_), (force, *_), stick = coulomb(law, (z, 0.0, 0.0), (v, 0.0, 0.0), 1.0, dt, 0.0)
        assert stick and force == approx(f)
    assert z == approx(f / 400.0 * (1.0 - np.exp(-400.0 * 0.04 / 8.0)), rel=1e-3)


@pytest.mark.notes(UNTAKEN, "may not come to rest", "the finger does not rest")
def test_a_lightly_held_finger_with_a_delayed_device_rests():
    held = {}
    for name, sets in (("now", []), ("undamped", UNDAMPED)):
        ensemble = palpate.Ensemble("kidney", 1, keep=["controller.force"], duration=2.2,
                                    sets=[*LIGHT, "friction.use=friction.Coulomb", *sets])  # fmt: skip
        force = np.asarray(ensemble.run(quiet=True)["controller.force"])[0, -500:]
        held[name] = np.sqrt(((force - force.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert held["undamped"] > 0.2, "the spring of 1500 N/m oscillates"
    assert held["now"] < 0.03


def watched(force, speed=0.0, dt=1e-3):
    state = blank_record(UNREST)
    for f in force:
        watch(state, (float(f), 0.0, 0.0), (speed, 0.0, 0.0), dt)
    return state


def test_an_oscillation_in_place_is_noticed_and_a_drift_or_a_slide_is_not():
    t = np.arange(1 + round(LONG * WINDOW / 1e-3)) * 1e-3
    swing = np.sin(2.0 * np.pi * 25.0 * t)
    assert watched(2.0 * LIMIT * swing).worst == approx(2.0 * LIMIT / np.sqrt(2.0), rel=0.02)
    assert watched(LIMIT * swing).worst == 0.0
    assert watched(3.0 * t).worst == 0.0, "a steady drift"
    assert watched(2.0 * LIMIT * swing, speed=0.01).windows == 0.0, "a slide"
    assert watched(2.0 * LIMIT * swing[:-300]).worst == 0.0, "too short"
