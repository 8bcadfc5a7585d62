"""Inputs of the afferents under a finger's patch: the published sums over the contact, shear, grid, slow messages."""

import math
import re

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.nodes.tactile import Afferents
from palpate.nodes.tactile.stress import Stress
from palpate.physics.afferents import population
from palpate.physics.afferents.published import DEPTHS, PROBE
from palpate.physics.contact.spread import kernel_values
from palpate.physics.contact.subsurface import under_patch

SA1, RA1, PC = range(3)
R = 8e-3


def load(force):
    return Load(nodes=np.zeros(1, "<i4"), forces=np.array([force], float), foot=(0, 0, 0), normal=(0.0, 0.0, 1.0))


def stress(**settings):
    return Stress(**({"depths": DEPTHS, "reach": 8e-3, "poisson": 0.45} | settings))


def published_inputs(kind, at):
    """Static and dynamic input per newton and N/s, [MPa] and [MPa/(mm s)], of a receptor at x [m] below a biweight
    patch: the sum over flat pins of the probe's radius, as in the skin of TouchSim. A pin under the force P makes the
    vertical stress of I. N. Sneddon (1946) on its axis; off the axis that of a point is near enough, 0.1 R away and
    more. Under it the surface moves by P/(2 E* a), and by P asin(a/r)/(pi E* a) at the distance r."""
    line = np.arange(-R, R, 0.1e-3) + 0.05e-3
    source = np.stack(np.meshgrid(line, line, indexing="ij"), -1).reshape(-1, 2)
    share = kernel_values("biweight", np.minimum(np.hypot(*source.T) / R, 1.0))
    share /= share.sum()
    r, z = 1e3 * np.hypot(source[:, 0] - at, source[:, 1]), 1e3 * DEPTHS[kind]
    rho = np.sqrt(r * r + z * z)
    static = np.sum(share * 3.0 * z**3 / (2.0 * math.pi * rho**5))
    a = 1e3 * PROBE
    under = np.where(r > a, np.arcsin(np.minimum(a / np.maximum(r, a), 1.0)) / (math.pi * a), 1.0 / (2.0 * a))
    return static, np.sum(share * under) / z**2


@pytest.mark.parametrize("kind", [SA1, RA1, PC])
@pytest.mark.parametrize("at", [0.0, 4e-3])
def test_under_a_patch_the_inputs_are_the_published_sums_over_the_contact(kind, at):
    sent = FakeBus(stress()).publish(load((0, 0, -1.0)))[0]
    corners, weights = np.zeros((1, 8), np.int32), np.zeros((1, 8))
    place = np.array([(at, 0.0, DEPTHS[kind])])
    assert population.place(sent.points, place, corners, weights) == (0, 0)
    static, dynamic = published_inputs(kind, at)
    found = 1e-6 * population.traction(sent.stress, corners[0], weights[0])
    assert found == approx(static, rel=0.001) if at == 0.0 else static < found < 1.06 * static  # with some shear stress
    found = 1e-3 * population.deflection_stimulus(sent.deflection, corners[0], weights[0]) / (1e3 * DEPTHS[kind]) ** 2
    assert found == approx(dynamic, rel=0.03)


def rates(node, force, ramp=100, hold=500):
    """Mean rates [1/s] of the three types in a hold of this force [N] after a ramp of 0.1 s."""
    source, bus = FakeBus(stress()), FakeBus(node)
    counts = np.zeros(3)
    for k in range(ramp + hold):
        share = min(k / ramp, 1.0)
        sent = source.publish(load(share * np.array(force)))[0]
        unit = bus.publish(sent)[0].unit
        if k >= ramp + 100:
            counts += np.bincount(node.population.kind[unit], minlength=3)
    return counts / np.maximum(np.bincount(node.population.kind, minlength=3), 1) / (1e-3 * (hold - 100))


@pytest.mark.parametrize(("stimulus", "low", "high"), [("traction", 0.6, 1.6), ("energy", 5.0, 50.0)])
def test_one_newton_of_shear_excites_sa1_as_much_as_one_of_pressure(stimulus, low, high):
    """By the traction at their depth. By the strain energy density shear counts many times as much, because a wide
    patch compresses nearly incompressible skin almost equally in all directions."""
    pressed, sheared = (
        rates(Afferents(densities=(0.3e6, 0, 0), stimulus=stimulus), force)[SA1]
        for force in ((0, 0, -2.0), (2.0, 0, 0))
    )
    assert pressed > 0.5 and low < sheared / pressed < high


def test_a_gain_scales_the_input_of_its_type():
    node = Afferents(densities=(0.1e6, 0.1e6, 0.1e6), gains=(1.0, 2.0, 0.5))
    FakeBus(node)
    one = Afferents(densities=(0.1e6, 0.1e6, 0.1e6))
    FakeBus(one)
    for name, each in (("gain", node), ("dynamic", node)):
        found = np.array(each._held[name]) / np.array(one._held[name])
        assert found == approx(np.array([1.0, 2.0, 0.5])[node.population.kind])


@pytest.mark.parametrize("radius", [2e-3, 4e-3, 8e-3])
def test_the_grid_follows_the_patch(radius):
    """Between its points the vertical stress is wrong by less than 6 % of its peak."""
    depth = DEPTHS[SA1]
    node = stress(radius=radius, depths=(depth,))
    sent = FakeBus(node).publish(load((0, 0, -1.0)))[0]
    receptors = population.scatter((0.5e6, 0.0, 0.0), 7e-3, (depth,) * 3, 1).at
    n = len(receptors)
    corners, weights = np.zeros((n, 8), np.int32), np.zeros((n, 8))
    assert population.place(sent.points, receptors, corners, weights) == (0, 0)
    found = np.array([w @ sent.stress[c, 2] for c, w in zip(corners, weights, strict=True)])
    right = -under_patch(receptors, radius, "biweight", 0.45)[:, 2, 2, 2]
    peak = -under_patch(np.array([[0.0, 0.0, depth]]), radius, "biweight", 0.45)[0, 2, 2, 2]
    assert np.abs(found + right).max() < 0.06 * peak
    assert not node.notes()


def test_a_grid_that_is_coarse_for_the_patch_is_reported_with_its_error():
    node = stress(radius=2e-3, spacing=2e-3)
    FakeBus(node)
    (note,) = node.notes()
    assert "2 mm apart under a patch of 2 mm" in note and "set 0.5 mm or less" in note
    assert 15 < int(re.search(r"up to (\d+) %", note)[1]) < 60


def test_slow_stress_is_reported_once():
    node = Afferents(densities=(0.1e6, 0, 0))
    source, bus = FakeBus(stress(), rate=100.0), FakeBus(node, rate=100.0)
    for _ in range(3):
        bus.publish(source.publish(load((0, 0, -1.0)))[0])
    assert "every 10 ms" in node.notes()[0] and not node.notes()
