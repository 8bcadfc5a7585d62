"""The drawn displacement past the border of a basis that describes a part of an organ."""

import numpy as np
import pytest
from pytest import approx

from palpate.messages import Load
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies.patch import lies_on
from palpate.physics.bodies.sampled.border import shares_past_border
from palpate.physics.geometry.mesh import Mesh

RADIUS, AROUND = 2.0, 72


def tube():
    """A tube round z of radius 2 from z = 0 to 1, closed by a cone below: its border is a circle."""
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    ring = RADIUS * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    vertices = np.concatenate([ring, ring + [0.0, 0.0, 1.0], [[0.0, 0.0, -1.0]]])
    k = np.arange(AROUND)
    after = (k + 1) % AROUND
    sides = np.concatenate([np.stack([k, after, AROUND + k], 1), np.stack([after, AROUND + after, AROUND + k], 1)])
    bottom = np.stack([after, k, np.full(AROUND, 2 * AROUND)], 1)
    return Mesh(vertices, np.concatenate([sides, bottom]).astype(np.int32))


def shares(coarse, points):
    return shares_past_border(coarse, points, *lies_on(coarse, Mesh(points, np.zeros((0, 3), np.int32))))


def test_the_share_falls_from_the_border_to_zero_at_its_radius():
    """(1 - x)² (1 + 2 x) is 27/32, 1/2 and 5/32 at the distances R/4, R/2 and 3 R/4."""
    coarse, x = tube(), np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.5])
    past = np.stack([np.full(6, RADIUS), np.zeros(6), 1.0 + RADIUS * x], axis=1)
    assert coarse.border.tolist() == list(range(AROUND, 2 * AROUND))
    assert shares(coarse, past) == approx([1.0, 27 / 32, 0.5, 5 / 32, 0.0, 0.0], abs=1e-9)
    axis = np.array([[0.0, 0.0, z] for z in (1.5, 2.0, 4.0)])
    assert shares(coarse, axis) == approx([0.0, 0.0, 0.0], abs=1e-9)


def test_other_points_move_as_their_nearest_one():
    coarse = tube()
    outside = np.array([[2.3, 0.0, 0.4], [0.0, -1.7, 0.5], [0.1, 0.1, -1.2]])
    assert (shares(coarse, outside) == 1.0).all()
    sphere = surface_mesh("sphere", 200)
    assert not len(sphere.border) and (shares(sphere, 1.1 * sphere.vertices) == 1.0).all()


def pressed(along):
    """The fingertip's surface and its displacement under 0.3 N on its pulp, at a place along the finger [m]."""
    body = ReducedFE(surface="fingertip", model="sampled", young=160.0, reach=0.1, position=(0.0, 0.0, 0.0))
    body.start()
    mesh, up = body.mesh(), (0.0, 0.0, 1.0)
    foot = mesh.vertices[np.argmin(np.linalg.norm(mesh.vertices - [0.0, along, 0.02], axis=1))]
    nodes = np.flatnonzero(np.linalg.norm(mesh.vertices - foot, axis=1) < 3e-3)
    forces = np.outer(np.full(len(nodes), -0.3 / len(nodes)), up)
    load = Load(nodes=nodes, forces=forces, foot=tuple(foot), normal=up)
    for _ in range(50):
        surface = body.step([load], dt=1e-3)
    moved = np.zeros_like(mesh.vertices)
    moved[surface.nodes] = surface.displacement
    return mesh, moved


@pytest.mark.parametrize("along", [0.0, -10e-3, -13e-3, -16e-3])
def test_the_drawn_fingertip_has_no_spike_past_its_basis(along):
    """The basis ends 12 mm behind the centre of the tip, the drawn surface 22 mm. Difference of the displacement along
    an edge over its length, past the border and in the basis; where the nearest point leaps it was 0.5 and more."""
    mesh, moved = pressed(along)
    edges = np.concatenate([mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    vertices, size = mesh.vertices, np.linalg.norm(moved, axis=1)
    ratio = np.linalg.norm(moved[edges[:, 0]] - moved[edges[:, 1]], axis=1)
    ratio /= np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    past = vertices[edges][:, :, 1].max(axis=1) < -12e-3
    assert 0.01 < ratio[past].max() < 0.75 * ratio[~past].max()
    assert 0.9e-3 < size.max() < 1.7e-3 and size[vertices[:, 1] < -21.5e-3].max() == 0.0
