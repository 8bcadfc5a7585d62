"""The law of large displacement compared with other finite elements, at radii, depths and materials outside its fit,
and with the linear law: it must be better wherever it is used."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from pressing import CondensedBody, Spreader
from pytest import approx
from scipy.sparse import csc_array, eye_array, kron
from scipy.sparse.linalg import splu

from palpate.compiler.entry_point import NO_FLOATS
from palpate.models.fe.axisymmetric import RoundBody, line
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.large_displacement import (
    DEEPEST,
    large_depth,
    linear_depth,
    nonlinearity,
    stored_energy,
)  # fmt: skip
from palpate.physics.bodies.true_patch import HELD, MEAN
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.accuracy import kidney
from palpate.studies.peers.continuum import BED, POISSON, YOUNG

UP = (0.0, 0.0, 1.0)
POISSONS = (0.15, 0.33, 0.38, 0.42, 0.46, 0.48)


class RoundPress:
    """A cylinder of modulus 1 and patch radius 1 under the load 3f/pi (1 - r²)², whose surface does not slide at r < 1.

    foundation  stiffness per area of the elastic foundation, with a free side; None: bonded below, fixed at the side
    """

    def __init__(self, poisson, thickness, wide, cells, foundation=None):
        self.material = replace(neo_hooke(1.0, poisson), mixed=False)
        body = RoundBody(line(1.0, cells, wide), thickness - line(1.0, cells, thickness)[::-1], slides=False)
        fixed = body.fixed.copy()
        self.springs = csc_array((body.points.size,) * 2)
        if foundation is not None:
            fixed[:] = False
            fixed[body.points[:, 0] == 0.0, 0] = True
            edge, value, area = body.edges(body.base)
            block = foundation * np.einsum("lq,qa,qb->lab", area, value, value)
            rows, columns = np.repeat(edge, 3, axis=1).ravel(), np.tile(edge, (1, 3)).ravel()
            one = csc_array((block.ravel(), (rows, columns)), shape=(len(body.points),) * 2)
            self.springs = csc_array(kron(one, eye_array(2)))
        fixed[body.top[body.points[body.top, 0] < 1.0 + 1e-9], 0] = True
        self.body, self.free = body, np.flatnonzero(~fixed.ravel())
        edge, value, area = body.edges(body.top)
        square = np.minimum((body.points[edge, 0] @ value.T) ** 2, 1.0)
        load = np.zeros_like(body.points)
        np.add.at(load[:, 1], edge, np.einsum("lq,qa->la", (1.0 - square) ** 2 * area, value))
        self.load = -(load / load.sum()).ravel()[self.free]

    def balance(self, u):
        """Inner forces and tangent of the free nodes at displacements (2N,); None if an element is inverted."""
        body, elastic = self.body, self.body.forces(self.material, u.reshape(-1, 2))
        if elastic is None:
            return None
        inner, K = elastic
        whole = csc_array((K.ravel(), (body.rows, body.columns)), shape=(u.size, u.size)) + self.springs
        return (inner.ravel() + self.springs @ u)[self.free], csc_array(whole)[self.free][:, self.free]

    def excess(self, depths):
        """f c/s - 1 at growing mean indentations, c the compliance at rest."""
        u, force, out = np.zeros(self.body.points.size), 0.0, []
        self.compliance = float(self.load @ splu(self.balance(u)[1]).solve(self.load))
        for depth in depths:
            for _ in range(30):
                inner, K = self.balance(u)
                rest, gap = inner - force * self.load, depth - float(self.load @ u[self.free])
                if np.linalg.norm(rest) < 1e-8 * np.linalg.norm(force * self.load) and abs(gap) < 1e-10 * depth:
                    break
                factor = splu(K)
                away, along = factor.solve(-rest), factor.solve(self.load)
                more = (gap - self.load @ away) / (self.load @ along)
                way, length = away + more * along, 1.0
                tried = u.copy()
                tried[self.free] += way
                while self.balance(tried) is None:
                    length *= 0.5
                    tried = u.copy()
                    tried[self.free] += length * way
                u, force = tried, force + length * more
            else:
                raise AssertionError(f"no equilibrium at {depth}")
            out.append(force * self.compliance / depth - 1.0)
        return np.array(out)


def half_space(poisson):
    """Compliance of a half-space of modulus 1 under a patch of radius 1 whose surface does not slide."""
    return (1.0 - poisson**2) * MEAN / np.pi * (1.0 - HELD * ((1.0 - 2.0 * poisson) / (1.0 - poisson)) ** 2)


@pytest.mark.parametrize("poisson", [0.25, *(pytest.param(p, marks=pytest.mark.long) for p in POISSONS), 0.45])
def test_the_law_equals_the_full_solution_on_a_half_space(poisson):
    """The far border of the cylinder acts as a linear spring in series with the half-space of known compliance."""
    depths = np.array([0.07, 0.23, 0.44, 0.66, 0.85] + [1.04, 1.21, 1.43] * (poisson > 0.3))
    press = RoundPress(poisson, 25.0, 25.0, 6)
    force = (1.0 + press.excess(depths)) * depths / press.compliance
    own = depths + (half_space(poisson) - press.compliance) * force
    law = np.array([linear_depth(d, nonlinearity(poisson))[0] for d in own])
    assert law == approx(half_space(poisson) * force, rel=3e-3)


@pytest.mark.parametrize(
    ("radius", "poisson", "plain"), [(12e-3, 0.3, 0.034), (6e-3, 0.4, 0.009), (12e-3, 0.49, 0.011)]
)
def test_on_a_slab_the_radius_follows_the_compliance(radius, poisson, plain):
    """Force error up to s = R: 1.3, 0.3 and 1.0 % of the force; `plain` with the radius of the patch."""
    press, depths = (
        RoundPress(poisson, 0.04 / radius, 0.056 / radius, 6, BED * radius),
        np.array([0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 1.0]),
    )
    full = 1.0 + press.excess(depths)
    wide, rho = (press.compliance / half_space(poisson)) ** 2, nonlinearity(poisson)

    def error(radius):
        return np.abs([radius * linear_depth(d / radius, rho)[0] / d for d in depths] / full - 1.0).max()

    assert error(wide) < 0.014
    assert error(wide) < error(1.0) == approx(plain, abs=5e-4)


@lru_cache
def body_and_spreader(radius, poisson, large):
    node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=10000)
    rho = nonlinearity(poisson) if large else NO_FLOATS
    mesh = node.mesh()
    return CondensedBody(node.basis(), mesh, YOUNG, 0.0, radius, 1.0, poisson, rho=rho), Spreader(mesh, radius)


def indentation(body, spreader, force, foot=(0.0, 0.0, 0.0), normal=UP):
    """Static indentation [m] of a body under the kernel."""
    count = spreader.spread(foot, normal, tuple((-force * np.array(normal)).tolist()))
    return body.step(spreader.nodes[:count], spreader.forces[:count], foot, normal, 1e6)[2]


def no_worse(large, linear):
    """Errors with the law and of the linear body at growing depths."""
    assert large.max() < min(linear.max(), 0.025)
    assert np.sum(large**2) < np.sum(linear**2)
    assert large[large > linear].max(initial=0.0) < 0.015
    assert (large - linear).max() < 6e-3


@pytest.mark.parametrize("radius", [6e-3, *(pytest.param(r, marks=pytest.mark.long) for r in (8e-3, 12e-3))])
def test_the_body_on_the_slab_is_never_worse_than_the_linear_one(radius):
    """At equal depth, from s/R = 0.1 to 1.2. At some depths the linear body is nearer by less than 0.6 %; both are then
    within 1.5 %."""
    depths = np.array([0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.1, 1.2])
    full = 1.0 + RoundPress(POISSON, 0.04 / radius, 0.056 / radius, 6, BED * radius).excess(depths)
    errors = []
    for large in (True, False):
        body, spreader = body_and_spreader(radius, POISSON, large)
        compliance = indentation(body, spreader, 1e-6) / 1e-6
        forces = full * depths * radius / compliance
        found = np.array([indentation(body, spreader, f) for f in forces]) / (depths * radius)
        if large:
            wide, rho = radius * (compliance * YOUNG * radius / half_space(POISSON)) ** 2, nonlinearity(POISSON)
            law = [wide * large_depth(compliance * f / wide, rho)[0] for f in forces] / (depths * radius)
            assert found == approx(law, rel=2e-3)
        errors.append(np.abs(found - 1.0))
    no_worse(*errors)


@pytest.mark.long
@pytest.mark.parametrize(
    ("place", "radius", "poisson"),
    [(4.0, 8e-3, 0.45), (-17.0, 8e-3, 0.45), (20.0, 5e-3, 0.45), (-7.0, 12e-3, 0.45), (9.0, 8e-3, 0.3)],
)
def test_on_the_kidney_the_law_is_never_worse_than_the_linear_one(place, radius, poisson, monkeypatch):
    """At held-out positions, compared with the reference solver (2 cells per radius), which shares neither mesh nor
    basis with the body."""
    monkeypatch.setattr(kidney, "RADIUS", radius)
    monkeypatch.setattr(kidney, "POISSON", poisson)
    levels = np.array([0.01, 0.3, 0.6, 1.0, 1.5, 2.0, 2.5]) * (radius / 8e-3) ** 2
    curve = kidney.press_kidney(kidney.Kidney(1e-3 * place, 2), levels)
    depth, compliance = curve.indentation, curve.indentation[0] / levels[0]
    rho, wide = nonlinearity(poisson), radius * (compliance * YOUNG * radius / half_space(poisson)) ** 2
    linear = compliance * levels / depth
    large = np.array([wide * large_depth(compliance * f / wide, rho)[0] for f in levels]) / depth
    no_worse(np.abs(large - 1.0)[1:], np.abs(linear - 1.0)[1:])


@pytest.mark.parametrize("poisson", [0.0, 0.2, 0.3, 0.45, 0.499])
def test_the_law_rises_and_its_inverse_slopes_and_energy_are_consistent(poisson):
    rho, h = nonlinearity(poisson), 1e-6
    depths = np.array([-0.3, 0.01, 0.4, 0.9, 1.4, DEEPEST + 0.01, 2.5])
    for depth in depths:
        x, slope, curvature = linear_depth(depth, rho)
        above, below = linear_depth(depth + h, rho), linear_depth(depth - h, rho)
        assert slope > 0.8
        assert slope == approx((above[0] - below[0]) / (2 * h), rel=1e-6)
        assert curvature == approx((above[1] - below[1]) / (2 * h), rel=1e-5, abs=1e-8)
        assert large_depth(x, rho) == approx((depth, 1.0 / slope), rel=1e-12)
        assert x == approx((stored_energy(depth + h, rho) - stored_energy(depth - h, rho)) / (2 * h), rel=1e-6)
    assert (np.diff([large_depth(x, rho)[0] for x in np.linspace(-1, 20, 2000)]) > 0).all()
    assert math.isclose(stored_energy(0.3, NO_FLOATS), 0.045)
