"""The correction of the compliance stays with the loads of a history (physics.bodies.condensed_step)."""

from functools import cache

import numpy as np
import pytest
from pytest import approx

from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_body import CondensedBody, answer, bear, condensed_body, patch_energy
from palpate.physics.geometry.mesh import plane

YOUNG, TAU, DT = 19e3, 0.02, 1e-3
KEEP, TAKE = TAU / (TAU + DT), DT / (TAU + DT)
UP, FOOT = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
LITTLE = 1e-6  # [1] what the body yields of itself, over a half-space: nearly all of the compliance is the correction


def made(remembers: bool) -> CondensedBody:
    """A plane whose compliance is nearly all correction."""
    fine, coarse = plane(0.05, 10000), plane(0.1, 600)
    size = len(coarse.vertices)
    empty = Basis(coarse.vertices, coarse.triangles, np.zeros((3 * size, 3 * size), np.float32))
    body = condensed_body(empty, fine, YOUNG, TAU, 8e-3, 0.02, 0.45, sticks=False, remembers=remembers)
    compliance = np.zeros((3 * size, 3 * size), np.float32)
    compliance[2::3, 2::3] = LITTLE * body.model.true.table
    return body._replace(model=body.model._replace(compliance=compliance))


@cache
def patch(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, and forces [N] of one newton on a biweight patch of a radius [m]."""
    mesh = plane(0.05, 10000)
    weight = mesh.areas * np.maximum(1.0 - np.sum(mesh.vertices**2, axis=1) / radius**2, 0.0) ** 2
    nodes = np.flatnonzero(weight).astype(np.int32)
    return nodes, np.outer(weight[nodes] / weight.sum(), (0.0, 0.0, -1.0))


def press(body: CondensedBody, radius: float, force: float) -> tuple[float, np.ndarray, float]:
    """A step under a biweight patch of a radius [m]: the indentation [m], the shares of the coarse vertices, and the
    compliance at rest [m/N]."""
    nodes, pull = patch(radius)
    bear(body, 0, nodes, force * pull, FOOT, UP, DT)
    answer(body, np.zeros((1, 5)), DT)
    one, touched = body.contacts[0], body.marks[0, 2, : body.counts[0, 1]]
    shares = np.zeros(len(body.model.vertices))
    shares[touched] = body.fields[0, 2, touched, 0]
    return float(one["now"]), shares, float(one["self_compliance"])


@pytest.mark.parametrize("remembers", [True, False])
def test_a_history_has_the_mean_correction_of_its_loads(remembers):
    """A load at rest, and in the next step another one of the same force, whose correction is smaller. With that of the
    present place alone the tissue under it rose in one step by as much as it yields. The stored energy is half of the
    force times the indentation of its history."""
    body = made(remembers)
    for _ in range(400):
        before, first, c = press(body, 5e-3, 0.5)
    assert before == approx(0.5 * c, rel=1e-6)
    after, second, d = press(body, 8e-3, 0.5)
    assert d < 0.9 * c
    table = body.model.true.table.astype(float)
    pressed = 0.5 * (KEEP * (second @ table @ first) / (second @ table @ second) + TAKE)
    right = KEEP * c + TAKE * d if remembers else d
    assert after == approx(right * pressed, rel=1e-4)
    assert patch_energy(body) == approx(0.5 * after * pressed, rel=1e-4)


def test_at_one_place_nothing_changes():
    """Also while the force changes. Without a load the patch is that of the scene, of the same radius."""
    one, two = made(True), made(False)
    for k in range(80):
        force = 0.4 + 0.2 * np.sin(0.3 * k)
        found, right = press(one, 8e-3, force)[0], press(two, 8e-3, force)[0]
        assert found == approx(right, rel=1e-9)
    nothing, before = (np.zeros(0, np.int32), np.zeros((0, 3))), found
    for k in range(1, 81):
        for body in (one, two):
            bear(body, 0, *nothing, FOOT, UP, DT)
            answer(body, np.zeros((1, 5)), DT)
        found, right = (float(body.contacts[0]["now"]) for body in (one, two))
        assert found == approx(right, rel=0.01)
        assert found == approx(before * KEEP**k, rel=0.01)
