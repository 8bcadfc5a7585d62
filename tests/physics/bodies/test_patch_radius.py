"""The radius of a patch on the coarse surface, and the hats that widen it."""

import numpy as np
from pytest import approx

from palpate.models.fe.reduce.snapshots import patch
from palpate.nodes.base.surface import surface_mesh
from palpate.physics.bodies.patch import hat_moments, patch_radius


def test_the_radius_of_a_patch_is_that_of_its_pressure():
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
