"""Contact against closed forms: uniform pressure, Coulomb's limit, Hertz."""

from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import Pair, Settings, Solver, TetMesh, box, linear, neo_hooke, plane, quadratic, sphere
from palpate.models.fe.contact.area import contact_area
from palpate.models.fe.contact.rigid import RigidIndenter
from palpate.models.fe.element import faces as rule
from palpate.models.fe.element.mesh import bricks, grid

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
    down = (0.0, 0.0, -1.0)
    touch = RigidIndenter(top_faces(mesh, 1.0), plane, down, lambda load: np.array([0, 0, 1.0 - 0.2 * load]))
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
    touch = RigidIndenter(top_faces(mesh, 1.0), sphere, (1.0,), lambda load: np.array([0.5, 0.5, 3.0 - 0.5 * load]))
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, sliding_base(mesh), contacts=[touch])
    body.advance(1.0)
    assert np.abs(body.displacement).max() == 0.0
    assert (touch.force == 0.0).all() and touch.contact_area(body.displacement) == 0.0


def test_a_dragged_block_sticks_and_then_slides_at_the_coefficient_of_friction():
    mesh = box((1.0, 1.0, 0.5), (2, 2, 1))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)

    def path(load):
        return np.array([0.4 * max(load - 1.0, 0.0), 0.0, 0.5 - 0.05 * min(load, 1.0)])

    touch = RigidIndenter(top_faces(mesh, 0.5), plane, (0.0, 0.0, -1.0), path, friction=0.3)
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


def test_a_run_that_is_resumed_takes_the_steps_of_an_unbroken_one(tmp_path):
    def dragged():
        mesh = box((1.0, 1.0, 0.5), (2, 2, 1))
        fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
        touch = RigidIndenter(top_faces(mesh, 0.5), plane, (0.0, 0.0, -1.0),
                      lambda load: np.array([0.2 * load, 0.0, 0.5 - 0.05 * load]), friction=0.3)  # fmt: skip
        return Solver(mesh, {0: neo_hooke(1e4, 0.3)}, fixed, contacts=[touch])

    class Broken(Exception):
        pass

    def broken(load):
        loads.append(load)
        body.save(tmp_path / "state.npz")
        if len(loads) == 3:
            raise Broken

    whole, loads, every = dragged(), [], []
    whole.advance(1.0, every.append)
    body = dragged()
    with pytest.raises(Broken):
        body.advance(1.0, broken)
    body = dragged()
    body.resume(tmp_path / "state.npz")
    body.advance(1.0, loads.append)
    assert loads == every and len(every) > 4
    assert (body.displacement == whole.displacement).all()


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
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, ends | sides, lambda load: -0.04 * load * np.outer(z > 1 - 1e-9, UP),
                  contacts=[touch])  # fmt: skip
    body.advance(1.0)
    whole = box((1.0, 1.0, 1.0), (1, 1, 1))
    zw = whole.points[:, 2]
    wide = sliding_base(whole) | np.stack([0 * zw, 0 * zw, zw > 1 - 1e-9], axis=1).astype(bool)
    one = Solver(whole, {0: neo_hooke(1e4, 0.3)}, wide, lambda load: -0.04 * load * np.outer(zw > 1 - 1e-9, UP))
    one.advance(1.0)
    assert touch.force[2] == approx(-one.reaction[zw > 1 - 1e-9, 2].sum(), rel=5e-3)
    low = node < split
    assert body.reaction[low, 2].sum() == approx(-body.reaction[~low, 2].sum(), rel=1e-5)
    assert float(-touch.gap.min()) <= touch.bound


def dragged(friction):
    """A box pressed on a longer and much stiffer one, which stays flat, and pulled along: the pair, and the body."""
    low, high = box((2.0, 1.4, 0.5), (2, 2, 1)), box((1.0, 1.0, 0.5), (2, 2, 1))
    split, count = len(low.points), len(low.elements)
    points = np.concatenate([low.points, high.points + (0.3, 0.2, 0.5)])
    elements = np.concatenate([low.elements, high.elements + split])
    mesh = TetMesh(points, elements, (np.arange(len(elements)) < count).astype(int))
    z = mesh.points[:, 2]
    between = np.abs(mesh.points[mesh.faces][:, :, 2] - 0.5).max(axis=1) < 1e-9
    above = (mesh.faces >= split).all(axis=1)
    touch = Pair(mesh.faces[between & above], mesh.faces[between & ~above], friction)
    fixed = np.repeat(((z < 1e-9) | (z > 1 - 1e-9))[:, None], 3, axis=1)
    top = z > 1 - 1e-9

    def held(load):
        return np.outer(top, (0.3 * max(load - 1.0, 0.0), 0.0, -0.05 * min(load, 1.0)))

    return touch, Solver(mesh, {0: neo_hooke(1e4, 0.3), 1: neo_hooke(1e8, 0.3)}, fixed, held, contacts=[touch])


def test_one_body_slides_on_another_at_the_coefficient_of_friction():
    touch, body = dragged(0.3)
    body.advance(2.0)
    assert touch.slip[touch.traction > 0].mean() > 0.9
    assert np.hypot(*touch.force[:2]) == approx(0.3 * abs(touch.force[2]), rel=1e-3)
    assert touch.force[0] < 0.0  # the lower holds the upper back
    low = body.mesh.points[:, 2] < 1e-9
    assert body.reaction[low].sum(axis=0) == approx(touch.force, abs=1e-4 * np.linalg.norm(touch.force))


def patch(radius, gap, edge=0.1):
    """Area of contact that is found where the gap grows as it does round a Hertz contact of some radius."""
    mesh = box((1.0, 1.0, 0.1), (round(1 / edge), round(1 / edge), 1))
    faces = top_faces(mesh, 0.1)
    nodes = mesh.points[faces]
    value, _ = rule.shape(rule.POINTS)
    away = np.linalg.norm(np.einsum("qa,fai->fqi", value, nodes)[..., :2] - (0.43, 0.52), axis=2) - radius
    open_by = gap * np.maximum(away, 0.0) ** 1.5
    return contact_area(nodes, open_by, np.where(away < 0, 1.0, 0.0))


def test_the_area_is_found_inside_the_faces():
    for gap in (1e-3, 1.0):  # its size does not matter, its growth does
        for radius in (0.1, 0.2, 0.3):
            assert patch(radius, gap) == approx(np.pi * radius**2, rel=0.02)
    errors = [abs(patch(0.21, 1.0, edge) / (np.pi * 0.21**2) - 1.0) for edge in (0.1, 0.05)]
    assert errors[1] < max(0.6 * errors[0], 1e-3)


def test_the_area_of_all_faces_and_of_none():
    mesh = box((1.0, 1.0, 0.1), (3, 3, 1))
    nodes = mesh.points[top_faces(mesh, 0.1)]
    none = np.zeros((len(nodes), 6))
    assert contact_area(nodes, none, none) == 0.0
    assert contact_area(nodes, none, none + 1.0) == approx(1.0)
    rim = np.where(np.arange(len(nodes))[:, None] < 9, 0.0, np.inf) + none  # half of it past the other body's rim
    assert contact_area(nodes, rim, np.where(rim < 1.0, 1.0, 0.0)) == approx(0.5)


def test_the_area_grows_smoothly_with_the_load():
    mesh = box((1.0, 1.0, 0.5), (6, 6, 2))
    fixed = np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)
    touch = RigidIndenter(top_faces(mesh, 0.5), sphere, (0.8,), lambda load: np.array([0.48, 0.53, 1.3 - 0.12 * load]))
    body = Solver(mesh, {0: neo_hooke(1e4, 0.3)}, fixed, contacts=[touch], settings=Settings(largest=0.1))
    loads, areas = [], []
    body.advance(1.0, lambda load: (loads.append(load), areas.append(touch.contact_area(body.displacement))))
    loads, areas = np.array(loads), np.array(areas)
    assert (np.diff(areas) > 0).all()
    smooth = np.polyval(np.polyfit(loads, areas, 3), loads)
    assert np.abs(areas - smooth).max() < 0.02 * areas[-1]


def boussinesq(p, force, young, poisson):
    """Displacement of the half-space z < 0 by a force into it; K. L. Johnson, Contact Mechanics, eq. 3.18."""
    r, down = np.linalg.norm(p, axis=1), -p[:, 2]
    out = down / r**3 - (1 - 2 * poisson) / (r * (r + down))
    sink = down**2 / r**3 + 2 * (1 - poisson) / r
    unit = np.stack([out * p[:, 0], out * p[:, 1], -sink], axis=1)
    return force * (1 + poisson) / (2 * np.pi * young) * unit


@lru_cache
def pressed(poisson, faces, ball=False, ratio=1e-4, size=30.0):
    """A rigid sphere on a block, or an elastic ball on a rigid plane; a quarter, held to the far field of theory at
    `size` radii of contact. The contact, the body, Hertz's force [N] and radius [m]."""
    radius, young = 0.01, 1e4
    depth = ratio * radius
    a = np.sqrt(radius * depth)
    h = a / faces
    x, z = [h * i for i in range(int(1.4 * faces) + 1)], [0.0]
    while z[-1] < size * a:
        z.append(z[-1] + h)
        h *= 1.8
    while x[-1] < size * a:
        x.append(x[-1] + 2.2 * (x[-1] - x[-2]))
    points, hexahedra = grid(np.array(x), np.array(x), -np.array(z[::-1]))
    mesh = quadratic(points, bricks(points, hexahedra))
    p, near = mesh.points, 1e-9 * a
    far = (p[:, 0] > x[-1] - near) | (p[:, 1] > x[-1] - near) | (p[:, 2] < near - z[-1])
    fixed = np.stack([(p[:, 0] < near) | far, (p[:, 1] < near) | far, far], axis=1)
    top = mesh.faces[(p[mesh.faces][:, :, 2] > -near).all(axis=1)]
    if ball:  # the flat top becomes a sphere
        p[:, 2] -= (radius - np.sqrt(radius**2 - p[:, 0] ** 2 - p[:, 1] ** 2)) * (1 + p[:, 2] / z[-1])
    top = top[np.linalg.norm(p[top[:, :3]].mean(axis=1), axis=1) < 2.2 * a]
    force = 4.0 / 3.0 * young / (1 - poisson**2) * np.sqrt(radius) * depth**1.5
    held = np.zeros_like(p)
    held[far] = boussinesq(p[far], force, young, poisson)
    indenter = (plane, (0.0, 0.0, -1.0)) if ball else (sphere, (radius,))
    touch = RigidIndenter(
        top, *indenter, lambda load: np.array([0, 0, (0 if ball else radius) - load * depth]), bound=depth / 1000
    )
    body = Solver(mesh, {0: linear(young, poisson)}, fixed, lambda load: load * held, contacts=[touch],
                  settings=Settings(step=1.0, largest=1.0))  # fmt: skip
    body.advance(1.0)
    return touch, body, force, a


def hertz(poisson, faces, ball=False):
    """Force and contact area over Hertz's."""
    touch, body, force, a = pressed(poisson, faces, ball)
    return 4 * abs(touch.force[2]) / force, 4 * touch.contact_area(body.displacement) / (np.pi * a**2)


def pressure_errors(faces):
    """L2 errors of the pressure relative to Hertz: of the tractions at the points, and of the linear field."""
    touch, body, force, a = pressed(0.3, faces)
    nodes, field = touch.pressure(body.displacement)
    whole = np.zeros(len(body.mesh.points))
    whole[nodes] = field
    x, y = rule.POINTS.T
    linear_field = whole[touch.faces[:, :3]] @ np.stack([1 - x - y, x, y])
    place = np.einsum("qa,fai->fqi", rule.shape(rule.POINTS)[0], body.mesh.points[touch.faces])
    away = np.minimum(np.linalg.norm(place, axis=2) / a, 1.0)
    right = 1.5 * force / (np.pi * a * a) * np.sqrt(1.0 - away**2)
    norm = (touch.area * right**2).sum()
    return [float(np.sqrt((touch.area * (part - right) ** 2).sum() / norm)) for part in (touch.traction, linear_field)]


def test_the_linear_field_of_pressure_has_the_force_of_the_contact_and_not_its_scatter():
    touch, body, _, _ = pressed(0.3, 2)
    area = rule.areas(body.mesh.points + body.displacement, touch.faces)
    x, y = rule.POINTS.T
    field = touch.nodal_pressure(body.displacement)
    total = (area * (field[touch.faces[:, :3]] @ np.stack([1 - x - y, x, y]))).sum()
    assert total == approx((touch.area * touch.traction).sum(), rel=1e-9)
    assert total == approx(abs(touch.force[2]), rel=1e-2)
    scattered, smooth = pressure_errors(2)
    assert smooth < 0.5 * scattered


@pytest.mark.long
def test_the_linear_field_of_pressure_converges_to_hertz_with_the_first_power_of_the_faces():
    """Its slope is infinite at the edge, which no smooth field has; the points themselves do not converge."""
    (rough, coarse), (still, fine) = pressure_errors(2), pressure_errors(4)
    assert np.log2(coarse / fine) > 0.8
    assert fine < 0.1
    assert still > 0.5 * rough


def test_hertz_on_a_coarse_mesh():
    force, area = hertz(0.3, 2)
    assert force == approx(1.0, abs=0.04)
    assert area == approx(1.0, abs=0.08)


@pytest.mark.long
@pytest.mark.parametrize("ball", [False, True])
@pytest.mark.parametrize(("poisson", "faces"), [(0.3, 4), (0.45, 5)])
def test_hertz_within_one_per_cent_and_its_area_within_three(poisson, faces, ball):
    force, area = hertz(poisson, faces, ball)  # theory holds to the order of (contact radius)/(sphere radius)
    assert force == approx(1.0, abs=0.01)
    assert area == approx(1.0, abs=0.03)
