"""Pressing the full organ, its surface held as by a finger that sticks, and what the body makes of it."""

from functools import lru_cache

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import cumulative_simpson
from scipy.sparse.linalg import spsolve

from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.indentation import OrganPress
from palpate.models.fe.reduce.indentation_table import (
    continued,
    dent_table,
    patch,
    press,
    pressed_places,
    scattered,
    spread_out,
    sticking,
)
from palpate.models.fe.reduce.reducible import of_organ
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_body import CondensedBody
from palpate.physics.bodies.indentation_table import SOFTEST, SPACING, hat_moments, patch_radius
from palpate.physics.geometry.mesh import plane

YOUNG, POISSON = 2e4, 0.45
RADIUS, NARROW = 12e-3, 8e-3
PRESSED = 8
DEPTHS = (2e-3, 6e-3)


@lru_cache
def organ():
    return of_organ(Organ(surface_mesh("sphere", 100), POISSON))


@lru_cache
def slab():
    return of_organ(Organ(plane(0.05, 100), POISSON))


@lru_cache
def bodies():
    """With dents and without."""
    mesh, compliance = organ().surface, organ().compliance().astype(np.float32)
    tables = dent_table(organ(), PRESSED, RADIUS, levels=4), np.zeros((0, 0))
    return [
        CondensedBody(Basis(mesh.vertices, mesh.triangles, compliance, t), mesh, YOUNG, 0.0, RADIUS, 1.0)
        for t in tables
    ]


def missed(feet, normals):
    """Error of the indentation, with dents and without (2,P,2), under the forces that press the full model."""
    mesh = organ().surface
    patches = np.stack([patch(mesh, foot, n, RADIUS) for foot, n in zip(feet, normals, strict=True)])
    curves = press(organ(), patches, np.tile(DEPTHS, (len(feet), 1)))
    errors = np.zeros((2, len(feet), 2))
    for k, (foot, n, load, curve) in enumerate(zip(feet, normals, patches, curves, strict=True)):
        nodes = np.flatnonzero(np.abs(load).max(axis=1) > 0).astype(np.int32)
        for j, (depth, force) in enumerate(zip(DEPTHS, YOUNG * curve.force, strict=True)):
            for i, body in enumerate(bodies()):
                law = body.step(nodes, force * load[nodes], tuple(foot.tolist()), tuple(n.tolist()), 1e3)
                errors[i, k, j] = law[2] / depth - 1.0
    return np.abs(errors)


def test_where_the_organ_was_pressed_the_body_repeats_the_full_model():
    feet, normals = pressed_places(organ().surface, PRESSED, RADIUS)
    dented, linear = missed(feet[[0, 5]], normals[[0, 5]])
    assert dented.max() < 5e-3
    assert linear.min() > 2e-2


def test_where_it_was_not_pressed_the_error_is_a_fraction_of_the_linear_ones():
    mesh, rng = organ().surface, np.random.default_rng(1)
    upper = mesh.triangles[rng.choice(np.flatnonzero(mesh.face_vectors[:, 2] > 0.0), 5)]
    inside = rng.dirichlet((1.0, 1.0, 1.0), 5)[:, :, None]
    feet, normals = (inside * mesh.vertices[upper]).sum(axis=1), (inside * mesh.normals[upper]).sum(axis=1)
    dented, linear = missed(feet, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    assert dented.mean() < 0.3 * linear.mean()
    assert (dented < linear).all()


@lru_cache
def one_place(sticks):
    """A place of the slab, pressed: unit load on the nodes (N,3), means that are held, depths, curve, radius."""
    hats, mesh = slab().hats, slab().surface
    load = patch(mesh, np.array([1e-3, 2e-3, 0.0]), np.array([0.0, 0.0, 1.0]), NARROW)
    held, depths = sticking(hats, load), 0.75e-3 * np.arange(1, 12)
    every = np.arange(len(load))
    across = patch_radius(mesh.vertices, hat_moments(mesh), every, len(every), -load[:, 2:])
    model = OrganPress(slab())
    (curve,) = model.run([model.curve(hats @ load, depths, held if sticks else None)])
    return hats @ load, held, depths, curve, across


@pytest.mark.long
def test_the_forces_that_pressing_finds_bring_newtons_method_to_the_same_indentations():
    load, held, depths, curve, _ = one_place(True)
    unit = (
        spsolve(
            slab().elastic.pattern.matrix(slab().elastic.tangent(np.zeros_like(slab().mesh.points))).tocsc(),
            load.ravel(),
        )
        * curve.stiffness
    )
    for k in (2, 9):
        forces = YOUNG * (curve.multipliers[k, 0] * load + (curve.multipliers[k, 1:] @ held).reshape(-1, 3))
        model = slab().solver(YOUNG, lambda share, forces=forces: share * forces)
        model.advance(1.0)
        assert float(np.sum(load * model.displacement)) == approx(depths[k], rel=1e-3)
        linear = held @ unit * depths[k]
        assert held @ model.displacement.ravel() == approx(linear, abs=1e-3 * depths[k])


@pytest.mark.parametrize("sticks", [True, False])
def test_the_work_of_pressing_is_what_the_organ_and_its_bed_hold(sticks):
    _, _, depths, curve, _ = one_place(sticks)
    known = np.isfinite(curve.force)
    work = cumulative_simpson(np.append(0, curve.force[known]), x=np.append(0, depths[known]))
    assert curve.energy[known] == approx(work, rel=2e-3)


def test_a_surface_that_may_slide_gives_way_near_twice_its_shear_modulus_and_one_that_sticks_does_not():
    """2G is for an incompressible half-space under an even pressure that keeps its direction."""
    _, _, _, curve, across = one_place(False)
    peak = 3.0 * YOUNG * np.nanmax(curve.force) / (np.pi * across**2)
    assert np.isnan(curve.force[-1])
    assert 0.7 < peak * (1.0 + POISSON) / YOUNG < 1.3
    assert np.isfinite(one_place(True)[3].force).all()


def test_holding_the_surface_adds_nothing_to_a_light_touch_and_little_force_along_it():
    free, sticks = one_place(False)[3], one_place(True)[3]
    assert sticks.stiffness == approx(free.stiffness, rel=1e-5)
    early = (sticks.force / free.force - 1.0)[:4]
    assert 0.0 < early[0] < 1e-2
    assert early == approx(early[0] * np.arange(1, 5) ** 2, rel=0.5)
    assert sticks.multipliers[:, 0] == approx(sticks.force, rel=0.02)


def test_a_patch_has_the_radius_of_its_pressure():
    mesh = surface_mesh("plane", 4000)
    every = np.arange(len(mesh.vertices))
    for radius in (6e-3, 15e-3):
        share = patch(mesh, np.zeros(3), np.array([0, 0, 1.0]), radius)
        equivalent = patch_radius(mesh.vertices, hat_moments(mesh), every, len(every), -share[:, 2:])
        assert equivalent == approx(radius, rel=0.12 if radius < 0.01 else 0.03)
        assert share.sum(axis=0) == approx([0, 0, -1])


def test_the_moment_of_a_hat_is_its_mean_square_distance():
    mesh = surface_mesh("plane", 80)
    rng = np.random.default_rng(0)
    v = 31
    total = weight = 0.0
    for tri in mesh.triangles[(mesh.triangles == v).any(axis=1)]:
        x = mesh.vertices[tri]
        area = np.linalg.norm(np.cross(x[1] - x[0], x[2] - x[0]))
        w = rng.dirichlet((1, 1, 1), 40000)
        hat = w[:, list(tri).index(v)]
        away = np.sum((w @ x - mesh.vertices[v]) ** 2, axis=1)
        total += area * np.mean(hat * away)
        weight += area * np.mean(hat)
    assert hat_moments(mesh)[v] == approx(total / weight, rel=0.02)


def test_values_are_carried_over_the_surface_and_kept_where_they_were_found():
    mesh = surface_mesh("plane", 80)
    chosen = scattered(mesh.vertices, 20, 12e-3)
    shares = np.stack([-patch(mesh, mesh.vertices[v], mesh.normals[v], 12e-3) @ mesh.normals[v] for v in chosen])
    values = np.stack([np.ones(20), shares @ mesh.vertices[:, 0]], axis=1)
    spread = spread_out(mesh.vertices, shares, values)
    assert spread[:, 0] == approx(np.ones(len(mesh.vertices)))
    assert shares @ spread == approx(values)
    assert spread[:, 1] == approx(mesh.vertices[:, 0], abs=5e-3)


def test_indentations_that_were_not_reached_go_on_as_the_parabola_of_the_last_three():
    lost = np.array([[0.1, 0.19, np.nan, np.nan], [0.09, np.nan, np.nan, 0], [0.1, 0.14, np.nan, np.nan], [np.nan] * 4])
    least = SOFTEST * SPACING
    expected = [[0.1, 0.19, 0.27, 0.34], [0.09, 0.17, 0.24, 0], [0.1, 0.14, 0.14 + least, 0.14 + 2 * least]]
    assert continued(lost) == approx(np.array([*expected, [0.1, 0.2, 0.3, 0.4]]))
