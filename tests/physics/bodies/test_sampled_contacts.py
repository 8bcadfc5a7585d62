"""A sampled body under several contacts (physics.bodies.sampled.contacts), compared with the full model."""

import numpy as np
import pytest
from pytest import approx
from sampled_slab import UP, YOUNG, at, body, compliance, slab

from palpate.models.fe.reduce.snapshots import LoadPath, press_from_rest
from palpate.physics.bodies.sampled.energy import forces as energies
from palpate.physics.bodies.sampled.energy import tangent
from palpate.physics.bodies.sampled.step import gamma

PLACES = ((-0.012, 0.004, 0.0), (0.011, -0.003, 0.0))


def loads(forces, places=PLACES):
    """Loads of these normal forces [N] on the slab."""
    made = []
    for place, force in zip(places, forces, strict=True):
        foot, n, nodes, push = at(place)
        made.append((nodes[: None if force else 0], (force * push)[: None if force else 0], foot, n))
    return made


def held(it, forces, places=PLACES, dt=1e6):
    """The laws after the body has settled."""
    for _ in range(12):
        laws = it.step_all(loads(forces, places), dt)
        if it.settled:
            break
    return laws


def shares(place):
    """Distribution of the normal force of a patch (V,3), from the loads alone."""
    _, _, nodes, push = at(place)
    share = np.zeros((len(slab().surface.vertices), 3))
    share[nodes] = push
    return share


def test_light_contacts_are_coupled_by_the_compliance_of_the_whole_body():
    """For near and distant points; the compliance is that of the full model's surface, without modes."""
    for places in (PLACES, ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((-0.03, 0.0, 0.0), (0.03, 0.0, 0.0))):
        it = body()
        laws = held(it, (1e-6, 2e-6), places)
        m = np.array([shares(place).ravel() for place in places])
        full = m @ compliance() @ m.T / YOUNG
        assert it.contacts.compliance == approx(full, rel=2e-3, abs=2e-3 * full.max())
        assert [law[3] for law in laws] == approx(full @ (1e-6, 2e-6), rel=2e-3)


def settled_depths(forces):
    """Indentations [m] at the minimum of the complementary energy under these forces, by Newton's method."""
    it, f = body(), sum(f * shares(place) for f, place in zip(forces, PLACES, strict=True)) / YOUNG
    basis = it.basis
    r = basis.modes.shape[1]
    q, g, K, p = np.zeros(r), np.zeros(r), np.zeros((r, r)), basis.modes.T @ f.ravel()
    for share in (0.25, 0.5, 0.75, *[1.0] * 12):
        assert tangent(basis.points, q, it.own.room, K)
        energies(basis.points, q, it.own.room, g)
        q += np.linalg.solve(K, share * p - g)
    bent = basis.residual_compliance.astype(float) @ f.ravel()
    u = basis.modes @ q + gamma(max(f.ravel() @ bent, 0.0), *basis.bend)[0] * bent
    return np.array([shares(place).ravel() @ u for place in PLACES]), q, K


def test_strong_contacts_are_coupled_by_the_tangent_compliance():
    """The tangent at the equilibrium is compared with differences of equilibria; it is reciprocal up to rounding."""
    forces, step = np.array([2.5, 1.5]), 0.05
    it = body()
    held(it, forces)
    now, q, K = settled_depths(forces)
    it.q[:], it.own.matrices[0] = q, np.linalg.inv(K)  # remove the residual of its iteration
    it.own.state["energy"] = energies(it.basis.points, it.q, it.own.room, it.own.vectors[2])
    laws = it.step_all(loads(forces), 1e6)
    assert [law[3] for law in laws] == approx(now, rel=1e-6)
    c = it.contacts.compliance
    assert c[0, 1] == c[1, 0] and 0.0 < c[0, 1] < np.sqrt(c[0, 0] * c[1, 1])
    rest = body()
    held(rest, (1e-6, 1e-6))
    assert np.abs(c / rest.contacts.compliance - 1.0).max() > 0.04  # no longer linear
    for j in range(2):
        apart = settled_depths(forces + step * np.eye(2)[j])[0] - settled_depths(forces - step * np.eye(2)[j])[0]
        assert c[:, j] == approx(apart / (2.0 * step), rel=2e-3)
    free = np.array([law[2] for law in laws])
    assert free + c @ forces == approx(now, rel=1e-6)  # the law is exact at the present forces


@pytest.mark.long
def test_two_strong_contacts_are_as_accurate_as_one():
    """The full model under both loads, and under the first alone: the basis has an error of 2 % in both cases."""
    push, forces = [shares(place) for place in PLACES], np.array([2.0, 1.0])
    levels = np.array([0.25, 0.5, 1.0]) / YOUNG
    both = LoadPath(np.zeros(3), np.array(UP), 2.0 * push[0] + push[1], levels)
    first = LoadPath(np.zeros(3), np.array(UP), 2.0 * push[0], levels)
    full, alone = press_from_rest(slab(), [both, first])
    found = [law[3] for law in held(body(count=22, of=28), forces)]
    truth = [np.sum((slab().hats @ one) * full.solutions[-1]) for one in push]
    assert found == approx(truth, rel=0.025)
    (law,) = held(body(count=22, of=28), forces[:1], PLACES[:1])
    assert law[3] == approx(np.sum((slab().hats @ push[0]) * alone.solutions[-1]), rel=0.025)
    assert truth[0] > 1.02 * law[3]  # the second finger lowers the surface under the first


def test_two_contacts_at_one_point_equal_one_with_both_forces():
    it, one = body(), body()
    laws = held(it, (1.0, 1.5), (PLACES[0], PLACES[0]))
    for _ in range(12):
        alone = one.step(*loads([2.5], PLACES[:1])[0], 1e6)
    assert it.coupling == approx(np.ones((2, 2)), rel=1e-9)
    assert [law[3] for law in laws] == approx([alone[3]] * 2, rel=5e-3)


def test_no_motion_of_two_contacts_generates_energy():
    it, rng = body(0.02), np.random.default_rng(4)
    work, most, before, places = 0.0, 0.0, np.zeros(2), np.array(PLACES)
    forces = np.zeros(2)
    for tick in range(1200):
        if tick % 100 == 0:
            goal = rng.uniform(0.0, 3.0, 2) * rng.integers(0, 2, 2) * (tick < 1000)
        forces += 0.05 * (goal - forces)
        forces[forces < 1e-3] = 0.0
        laws = it.step_all(loads(forces, places), 1e-3)
        now = np.array([law[3] for law in laws])
        work += float(forces @ (now - before))
        most, before = max(most, work), now
        assert all(np.isfinite(law).all() and law[0] > 0.0 for law in laws)
        assert work > -1e-3 * most
    assert most > 1e-3
