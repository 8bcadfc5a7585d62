"""Contact against closed forms: uniform pressure, Coulomb's limit, Hertz."""

import numpy as np
import pytest
from pytest import approx

from palpate.fe import Pair, Rigid, Settings, Solver, TetMesh, box, linear, neo_hooke, plane, quadratic, sphere
from palpate.fe.mesh import bricks, grid

UP = (0.0, 0.0, 1.0)


def top_faces(mesh, height):
    z = mesh.points[mesh.faces][:, :, 2]
    return mesh.faces[(np.abs(z - height) < 1e-9).all(axis=1)]


def sliding_base(mesh, height=0.0):
    """Rollers: x = 0, y = 0 and z = height planes keep their normal displacement."""
    x, y, z = mesh.points.T
    return np.stack([np.abs(x) < 1e-9, np.abs(y) < 1e-9, np.abs(z - height) < 1e-9], axis=1)


def test_a_rigid_plane_makes_uniform_pressure():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    touch = Rigid(top_faces(mesh, 1.0), plane, (0.0, 0.0, -1.0), lambda load: np.array([0, 0, 1.0 - 0.2 * load]))
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, sliding_base(mesh), contacts=[touch])
    body.advance(1.0)
    x, _, z = mesh.points.T
    fixed = sliding_base(mesh) | np.stack([0 * x, 0 * x, z > 1 - 1e-9], axis=1).astype(bool)
    driven = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, fixed, lambda load: -0.2 * load * np.outer(z > 1 - 1e-9, UP))
    driven.advance(1.0)
    held = driven.reaction[z > 1 - 1e-9, 2].sum()
    assert touch.force[2] == approx(held, rel=2e-3)
    assert np.ptp(touch.traction) < 2e-3 * touch.traction.mean()
    assert body.reaction[:, 2].sum() == approx(-touch.force[2], rel=1e-5)
    assert float(-touch.gap.min()) <= touch.bound
    assert (touch.traction * touch.area).sum() == approx(-touch.force[2])


def test_without_touch_nothing_moves():
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    touch = Rigid(top_faces(mesh, 1.0), sphere, (1.0,), lambda load: np.array([0.5, 0.5, 3.0 - 0.5 * load]))
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, sliding_base(mesh), contacts=[touch])
    body.advance(1.0)
    assert np.abs(body.displacement).max() == 0.0
    assert (touch.force == 0.0).all() and touch.contact_area(body.displacement) == 0.0


def test_a_dragged_block_sticks_and_then_slides_at_the_coefficient_of_friction():
    mesh = box((1.0, 1.0, 0.5), (2, 2, 1))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)

    def path(load):
        return np.array([0.4 * max(load - 1.0, 0.0), 0.0, 0.5 - 0.05 * min(load, 1.0)])

    touch = Rigid(top_faces(mesh, 0.5), plane, (0.0, 0.0, -1.0), path, friction=0.3)
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, fixed, contacts=[touch])
    body.advance(1.0)
    assert np.abs(touch.force[:2]).max() < 0.02 * abs(touch.force[2])  # the mesh is not symmetric
    body.advance(1.02)
    assert 0.0 < touch.force[0] < 0.25 * abs(touch.force[2])
    body.advance(2.0)
    assert touch.slip.mean() > 0.9
    assert np.hypot(*touch.force[:2]) == approx(0.3 * abs(touch.force[2]), rel=1e-3)
    assert body.reaction.sum(axis=0) == approx(-touch.force, abs=1e-5 * abs(touch.force[2]))


def stacked(cells_below, cells_above):
    """Two boxes one on the other, meshes that do not match."""
    low, high = box((1.0, 1.0, 0.5), cells_below), box((1.0, 1.0, 0.5), cells_above)
    points = np.concatenate([low.points, high.points + (0, 0, 0.5)])
    return TetMesh(points, np.concatenate([low.elements, high.elements + len(low.points)])), len(low.points)


def test_pressure_passes_between_meshes_that_do_not_match():
    mesh, split = stacked((2, 2, 1), (3, 3, 1))
    node = np.arange(len(mesh.points))
    z = mesh.points[:, 2]
    between = np.abs(mesh.points[mesh.faces][:, :, 2] - 0.5).max(axis=1) < 1e-9
    above = (mesh.faces >= split).all(axis=1)
    touch = Pair(mesh.faces[between & above], mesh.faces[between & ~above])
    ends = np.stack([0 * z, 0 * z, (z < 1e-9) | (z > 1 - 1e-9)], axis=1).astype(bool)
    sides = sliding_base(mesh)
    sides[:, 2] = False
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, ends | sides, lambda load: -0.1 * load * np.outer(z > 1 - 1e-9, UP),
                  contacts=[touch])  # fmt: skip
    body.advance(1.0)
    whole = box((1.0, 1.0, 1.0), (1, 1, 1))
    zw = whole.points[:, 2]
    wide = sliding_base(whole) | np.stack([0 * zw, 0 * zw, zw > 1 - 1e-9], axis=1).astype(bool)
    one = Solver(whole, {0: neo_hooke(1e4, 0.3)}, wide, lambda load: -0.1 * load * np.outer(zw > 1 - 1e-9, UP))
    one.advance(1.0)
    assert touch.force[2] == approx(-one.reaction[zw > 1 - 1e-9, 2].sum(), rel=5e-3)
    low = node < split
    assert body.reaction[low, 2].sum() == approx(-body.reaction[~low, 2].sum(), rel=1e-5)
    assert float(-touch.gap.min()) <= touch.bound


def hertz(poisson, near, growth, ratio=1e-3, law=linear):
    """A rigid sphere on a quarter of a large block: force over Hertz's, contact area over Hertz's."""
    radius, young = 0.01, 1e4
    depth = ratio * radius
    a = np.sqrt(radius * depth)
    h = 1.25 * a / near
    x = [h * i for i in range(near + 1)]
    while x[-1] < 400 * a:
        h *= growth
        x.append(x[-1] + h)
    points, found = grid(np.array(x), np.array(x), -np.array(x[::-1]))
    mesh = quadratic(points, bricks(points, found))
    p = mesh.points
    fixed = np.stack([p[:, 0] < 1e-9 * a, p[:, 1] < 1e-9 * a, 0 * p[:, 0] > 1], axis=1)
    fixed[p[:, 2] < -x[-1] * (1 - 1e-9)] = True
    top = mesh.faces[(p[mesh.faces][:, :, 2] > -1e-9 * a).all(axis=1)]
    top = top[np.linalg.norm(p[top[:, :3]].mean(axis=1), axis=1) < 2 * a]
    touch = Rigid(top, sphere, (radius,), lambda load: np.array([0, 0, radius - load * depth]), bound=depth / 1000)
    body = Solver(mesh, {0: law(young, poisson)}, fixed, contacts=[touch], settings=Settings(step=1.0, largest=1.0))
    body.advance(1.0)
    force = 4.0 / 3.0 * young / (1 - poisson**2) * np.sqrt(radius) * depth**1.5
    return 4 * abs(touch.force[2]) / force, 4 * touch.contact_area(body.displacement) / (np.pi * a**2)


def test_hertz_on_a_coarse_mesh():
    force, _ = hertz(0.45, 3, 3.0)
    assert force == approx(1.0, abs=0.04)


@pytest.mark.long
@pytest.mark.parametrize("poisson", [0.3, 0.45])
def test_hertz_within_one_per_cent(poisson):
    force, area = hertz(poisson, 4, 2.2, 1e-4)  # theory holds to the order of (contact radius)/(sphere radius)
    assert force == approx(1.0, abs=0.01)
    assert 0.75 < area < 1.02  # short by half an element at the rim
