"""The range of bodies of springs: the lag in a slide follows from the half-space, and the limits are noticed."""

import numpy as np
import pytest

from palpate.messages import Load
from palpate.nodes.deformation import MassSpring
from palpate.physics.bodies.spring_range import DEEP_NOTE, FAST, FAST_NOTE, LAG, too_deep
from palpate.physics.bodies.true_patch import MEAN
from palpate.physics.special import patch_depth

RADIUS = 8e-3


def test_the_lag_in_a_slide_is_that_of_a_viscous_half_space():
    """s/(c f) of a steady slide: the mean displacement under the patch by the loads of the past, by quadrature."""
    x, y = np.meshgrid(*2 * (np.linspace(-1.0, 1.0, 41),))
    weights = np.maximum(1.0 - x**2 - y**2, 0.0) ** 2
    apart = np.concatenate([np.linspace(0.0, 4.0, 41), np.geomspace(4.2, 60.0, 20)])
    means = [(weights * patch_depth(np.hypot(x + at, y))).sum() / weights.sum() / MEAN for at in apart]
    assert means[0] == pytest.approx(1.0, abs=1e-3)
    ages = np.linspace(0.0, 25.0, 5001)
    for q, error in LAG:
        softer = np.trapezoid(np.exp(-ages) * np.interp(q * ages, apart, means), ages)
        assert 1.0 - softer == pytest.approx(error, abs=0.006)


def test_the_radius_of_the_load_limits_the_depth():
    """A biweight load has R of twice its rms radius."""
    x, y = np.meshgrid(*2 * (np.linspace(-RADIUS, RADIUS, 41),))
    vertices = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    share = np.maximum(1.0 - (vertices**2).sum(axis=1) / RADIUS**2, 0.0) ** 2
    forces = np.zeros((len(vertices), 3))
    forces[:, 2] = -2.0 * share / share.sum()
    nodes, up = np.arange(len(vertices), dtype=np.int32), (0.0, 0.0, 1.0)
    for factor, beyond in ((1.47, False), (1.53, True)):
        assert too_deep(factor * RADIUS, vertices, nodes, forces, up, 2.0) == beyond


@pytest.mark.parametrize(("speed", "noted"), [(0.8, False), (1.2, True)])
def test_a_fast_slide_over_a_viscous_tissue_is_noted_and_jitter_is_not(speed, noted):
    body = MassSpring(surface="plane", vertices=400, position=(0.0, 0.0, 0.0), stiffness=250.0, exponent=1.0,
                      damping=0.0, retardation=0.02)  # fmt: skip
    body.start()
    step, jitter = speed * FAST * RADIUS / 0.02 * 1e-3, np.random.default_rng(1)
    for k in range(200):
        foot = (-0.02 + step * max(k - 100, 0) + jitter.choice([0.0, 6e-5]), 0.0, 0.0)
        load = Load(nodes=np.zeros(1, np.int32), forces=np.array([[0.0, 0.0, -0.5]]), foot=foot, normal=(0.0, 0.0, 1.0))
        body.step([load], dt=1e-3)
        assert k >= 100 or not body.own["beyond"] & FAST_NOTE, "a resting finger under an encoder is still"
    assert bool(body.own["beyond"] & FAST_NOTE) == noted and not body.own["beyond"] & DEEP_NOTE
    assert any("slides faster than 100 mm/s" in note for note in body.notes()) == noted
