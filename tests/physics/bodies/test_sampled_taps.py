"""Taps on the shipped fingertip, in steps of the loop: quasi-Newton compared with Newton's method with the tangent."""

import numpy as np
import pytest
from pressing import SampledBody, Spreader

from palpate.compiler.fields import blank_record
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.sampled.energy import forces, scratch, tangent
from palpate.physics.bodies.sampled.solve import BUDGET, settle

TAP = 50
FORCE = 0.5
UP = (0.0, 0.0, 1.0)


@pytest.fixture(scope="module")
def finger():
    node = ReducedFE(surface="fingertip", model="sampled", young=160.0, radius=5e-3, reach=12e-3)
    node.start()
    return node


def place(node, x, y):
    mesh, (cx, cy, _) = node.mesh(), node.position
    off = np.abs(mesh.vertices[:, 0] - cx - x) + np.abs(mesh.vertices[:, 1] - cy - y) - mesh.normals[:, 2]
    return cx + x, cy + y, float(mesh.vertices[np.argmin(off), 2])


def newton(points, p, q):
    """Equilibrium under p, from q, in double precision."""
    points = points._replace(modes=points.modes.astype(float))
    work, g, K = scratch(points), np.zeros_like(q), np.zeros((len(q), len(q)))
    for _ in range(60):
        energy = forces(points, q, work, g)
        residual = p - g
        assert tangent(points, q, work, K)
        d = np.linalg.solve(K, residual)
        if d @ residual < 1e-10 * abs(p @ q):
            return q
        length = 1.0
        while forces(points, q + length * d, work, g) - length * (p @ d) > energy - 1e-4 * length * (d @ residual):
            length *= 0.5
        q = q + length * d
    raise AssertionError("Newton's method did not converge")


@pytest.mark.parametrize("slant", [(0.0, 0.0), (0.2, -0.1)])
def test_taps_converge_within_their_duration(finger, slant):
    body = SampledBody.of(finger)
    points, spread = body.basis.points, Spreader(finger.mesh(), 5e-3, "biweight")
    settled, off = [], {20: [], TAP - 1: []}
    for k in range(6 * TAP):
        force = FORCE * (k // TAP % 2 == 0)
        foot = place(finger, *((0.0, 0.0), (1e-3, 3e-3), (-2e-3, -3e-3))[k // TAP // 2])
        count = spread.spread(foot, UP, (slant[0] * force, slant[1] * force, -force)) if force else 0
        body.step(spread.nodes[:count], spread.forces[:count], foot, UP, 1e-3)
        settled.append(body.settled)
        if force and k % TAP in off:
            p = body.own.vectors[0]
            exact = newton(points, p, body.q.copy())
            off[k % TAP].append(abs(p @ (body.q - exact)) / (p @ exact))
    assert np.mean(settled) > 0.6
    assert max(off[20]) < 2e-2 and max(off[TAP - 1]) < 3e-3


def test_a_stored_curvature_without_descent_is_discarded(finger):
    """Rounding errors may cause this after many updates."""
    body = SampledBody.of(finger)
    points, spread = body.basis.points, Spreader(finger.mesh(), 5e-3, "biweight")
    foot = place(finger, 0.0, 0.0)
    count = spread.spread(foot, UP, (0.0, 0.0, -FORCE))
    for _ in range(40):
        body.step(spread.nodes[:count], spread.forces[:count], foot, UP, 1e-3)
    r, p, answers = len(body.q), body.own.vectors[0], []
    for spoiled in (-np.eye(r), np.full((r, r), np.nan)):
        q, g, H, room = np.zeros(r), np.zeros(r), spoiled, np.zeros((2, r, r))
        energy, done = 0.0, False
        for _ in range(6):
            budget = blank_record(BUDGET, evaluations=14, length=1.0)
            energy, _, done = settle(points, scratch(points), p, q, g, H, *room, np.zeros((4, r)), energy, budget)
            if done:
                break
        assert done
        answers.append(p @ q)
    exact = p @ newton(points, p, body.q.copy())
    assert answers == pytest.approx([exact, exact], rel=5e-3)
