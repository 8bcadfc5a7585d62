"""The skin sheet: patch test, symmetry, and the closed form of a stretched strip."""

import numpy as np
import pytest
from pytest import approx

from palpate.physics.fingertip.skin import assemble, grid_triangles, plane_stress_blocks, sheet

INDEX = np.stack(np.meshgrid(np.arange(7), np.arange(5), indexing="ij"), -1).reshape(-1, 2)
POINTS = INDEX * 1e-3
E, NU, T = 1.36e5, 0.48, 1e-3


def dense(weight, scale=1.0):
    pad = sheet(POINTS, grid_triangles(INDEX), E, NU, T)
    sparse = np.zeros((len(pad.columns), 2, 2))
    assemble(sparse, pad, weight, scale)
    n = len(POINTS)
    full = np.zeros((n, 2, n, 2))
    for i in range(n):
        for s in range(pad.rows[i], pad.rows[i + 1]):
            full[i, :, pad.columns[s]] = sparse[s]
    return full.reshape(2 * n, 2 * n)


def test_each_cell_has_two_counter_clockwise_triangles():
    triangles = grid_triangles(INDEX)
    assert len(triangles) == 2 * 6 * 4
    a, b, c = (POINTS[triangles[:, k]] for k in range(3))
    p, q = b - a, c - a
    assert (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2 == approx(0.5e-6)


def test_the_stiffness_is_symmetric_and_zero_for_rigid_motion():
    k = dense(np.ones(len(POINTS)))
    assert k == approx(k.T, abs=1e-9)
    turn = np.stack([-POINTS[:, 1], POINTS[:, 0]], axis=1).ravel()
    for motion in (np.tile([1.0, 0], len(POINTS)), np.tile([0, 1.0], len(POINTS)), turn):
        assert k @ motion == approx(0, abs=1e-9)
    assert np.linalg.eigvalsh(k)[3] > 1e-3


def test_a_uniform_strain_gives_plane_stress_exactly():
    """Patch test: the energy of a uniform strain is that of the law times the area, without inner forces."""
    k = dense(np.ones(len(POINTS)))
    area = np.ptp(POINTS[:, 0]) * np.ptp(POINTS[:, 1])
    strain = np.array([[0.02, 0.005], [0.005, -0.01]])
    u = (POINTS @ strain).ravel()
    stress = E / (1 - NU**2) * ((1 - NU) * strain + NU * np.trace(strain) * np.eye(2))
    assert u @ k @ u == approx((stress * strain).sum() * area * T)
    inside = ((INDEX > 0) & (INDEX < [6, 4])).all(axis=1)
    assert (k @ u).reshape(-1, 2)[inside] == approx(0, abs=1e-9)


def test_a_virtual_node_disables_only_its_triangles():
    weight = np.ones(len(POINTS))
    middle = 3 * 5 + 2
    weight[middle] = 0
    k = dense(weight)
    assert not k[2 * middle : 2 * middle + 2].any()
    full = dense(np.ones(len(POINTS)))
    far = np.flatnonzero(np.abs(INDEX - INDEX[middle]).max(axis=1) > 1)
    dofs = (2 * far[:, None] + [0, 1]).ravel()
    assert np.diag(k)[dofs] == approx(np.diag(full)[dofs])


def test_the_directions_of_the_grid_are_equal():
    pad = sheet(POINTS, grid_triangles(INDEX), E, NU, T)
    first, second = pad.blocks[:, ::4, 0, 0].sum(), pad.blocks[:, ::4, 1, 1].sum()
    assert first == approx(second)


def test_a_triangle_without_area_is_an_error():
    with pytest.raises(ValueError, match="expected > 0"):
        plane_stress_blocks(np.zeros((3, 2)), np.array([[0, 1, 2]]), E, NU, T)
