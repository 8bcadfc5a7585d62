"""Taxels share the force of the contact, normal and shear, and their imperfections have the stated size."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.base import SettingError, effects
from palpate.nodes.sensor.taxels import Taxels
from palpate.physics.sensor.taxels import grid, neighbours, shares


def load(force, normal=(0.0, 0.0, 1.0)):
    """A load on the body (3) [N], on two vertices."""
    halves = 0.5 * np.array([force, force], float)
    return Load(nodes=np.arange(2, dtype=np.int32), forces=halves, foot=(0.0, 0.0, 0.0), normal=normal)


def reports(*forces, **settings):
    sent = FakeBus(Taxels(**settings)).publish(*(load(f) for f in forces))
    return np.array([m.forces for m in sent])


@pytest.mark.parametrize("kernel", ["biweight", "wendland", "cosine", "hertz"])
def test_shares_are_the_integral_of_the_pressure(kernel):
    """Against scipy's adaptive quadrature, and a sum of 1 of a grid that covers the patch."""
    k = {
        "biweight": lambda q: (1 - q**2) ** 2, "wendland": lambda q: (1 - q) ** 4 * (4 * q + 1),
        "cosine": lambda q: 0.5 * (1 + np.cos(np.pi * q)), "hertz": lambda q: np.sqrt(1 - q**2),
    }[kernel]  # fmt: skip

    def pressure(y, x):
        q = np.hypot(x, y) / 8e-3
        return k(q) if q < 1.0 else 0.0

    found = shares(np.array([[2e-3, -1e-3]]), 3e-3, 8e-3, kernel)[0]
    carried = dblquad(pressure, 0.5e-3, 3.5e-3, -2.5e-3, 0.5e-3)[0]
    whole = 4.0 * dblquad(pressure, 0.0, 8e-3, 0.0, lambda x: np.sqrt(64e-6 - x**2))[0]
    assert found == pytest.approx(carried / whole, rel=1e-5)
    assert shares(grid(5, 5, 4e-3), 4e-3, 8e-3, kernel).sum() == pytest.approx(1.0, abs=3e-3)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, -0.8, 0.6)])
def test_the_taxels_carry_the_whole_force_in_every_orientation(normal):
    """The known load: 0.1 kg gives 0.981 N normal, and its shear along the surface."""
    n = np.array(normal)
    tangent = np.cross(n, [0.3, 0.5, -0.2])
    tangent /= np.linalg.norm(tangent)
    node = Taxels(rows=6, columns=6, spacing=3e-3)
    (sent,) = FakeBus(node).publish(load(-0.981 * n + 0.4 * tangent, normal))
    total = sent.forces.sum(axis=0)
    assert total[2] == pytest.approx(0.981, rel=3e-3)
    assert np.hypot(*total[:2]) == pytest.approx(0.4, rel=3e-3)
    assert sent.positions.shape == (36, 2) and sent.forces[:, 2].max() == sent.forces[[14, 15, 20, 21], 2].max()


def test_the_shear_is_that_of_the_tissue_on_the_finger():
    """The finger drags the body along +x, so the body pulls at the finger along -x."""
    (forces,) = reports((0.5, 0.0, -1.0))
    assert forces[:, 0].sum() < 0.0 and np.abs(forces[:, 1]).max() < 1e-12 and (forces[:, 2] >= 0.0).all()


def test_a_grid_smaller_than_the_patch_loses_the_rest():
    one, four = (reports((0.0, 0.0, -1.0), rows=n, columns=n, spacing=4e-3)[0][:, 2] for n in (1, 2))
    assert one.sum() == pytest.approx(shares(np.zeros((1, 2)), 4e-3, 8e-3, "biweight")[0])
    assert 0.1 < one.sum() < four.sum() < 1.0 and four == pytest.approx(np.full(4, four[0]))


def test_gain_dead_taxels_and_crosstalk():
    true, scattered = (
        reports((0.0, 0.0, -1.0), rows=20, columns=20, spacing=0.8e-3, gain=g)[0][:, 2] for g in (0.0, 0.1)
    )
    seen = true > 1e-6
    assert (scattered / np.where(seen, true, 1.0))[seen].std() == pytest.approx(0.1, rel=0.15)
    dead = reports((0.3, 0.0, -1.0), dead=0.25)[0]
    assert (np.abs(dead).sum(axis=1) == 0.0).sum() == 4  # of 16
    (plain,), (mixed,) = reports((0.0, 0.0, -1.0)), reports((0.0, 0.0, -1.0), crosstalk=0.05)
    assert mixed[:, 2] == pytest.approx(plain[:, 2] + 0.05 * neighbours(4, 4) @ plain[:, 2], rel=1e-12)
    assert neighbours(3, 4).sum(axis=0).tolist() == [2, 3, 3, 2, 3, 4, 4, 3, 2, 3, 3, 2]


def test_noise_differs_between_channels_and_saturation_limits_each():
    forces = reports(*[(0.0, 0.0, -1.0)] * 3000, noise=0.01, seed=2)
    assert forces.std(axis=0) == pytest.approx(np.full((16, 3), 0.02), rel=0.1)
    assert reports((0.0, 0.0, -500.0), saturation=1.0)[0].max() == 2.0


def test_all_imperfections_are_effects_that_are_off_and_too_many_taxels_are_refused():
    switches = {effect.name: effect.setting for effect in effects(Taxels)}
    assert {"gain", "dead_taxels", "crosstalk", "hysteresis", "noise", "delay", "quantisation"} <= set(switches)
    assert all(getattr(Taxels(), setting) == 0.0 for setting in switches.values())
    with pytest.raises(SettingError, match="found 1600 taxels, expected at most 1024"):
        Taxels(rows=40, columns=40).start()
