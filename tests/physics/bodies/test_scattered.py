"""Loads that are not one patch, as on both rims of a groove (physics.bodies.loads.scattered)."""

import math
from functools import lru_cache

import numpy as np
import pytest
from pytest import approx
from scipy.integrate import quad

from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.condensed_body import answer, bear, condensed_body
from palpate.physics.bodies.loads.scattered import hat_means
from palpate.physics.bodies.patch import LEAST_MOMENT, compactness, load_radius
from palpate.physics.bodies.true_patch import MEAN, depth_at, depth_profile
from palpate.physics.geometry.mesh import Mesh, plane

POISSON, YOUNG = 0.45, 19e3
UP, FOOT = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
NORMAL = (1.0 - POISSON**2) / math.pi


def patches(mesh: Mesh, centres: list[tuple[float, float]], radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices, and forces [N] of one newton on equal biweight patches round these points [m] of a plane."""
    share = np.zeros(len(mesh.vertices))
    for x, y in centres:
        square = np.sum((mesh.vertices[:, :2] - (x, y)) ** 2, axis=1) / radius**2
        each = mesh.areas * np.maximum(1.0 - square, 0.0) ** 2
        share += each / each.sum() / len(centres)
    nodes = np.flatnonzero(share).astype(np.int32)
    return nodes, np.outer(share[nodes], (0.0, 0.0, -1.0))


def between(radius: float, apart: float) -> float:
    """Mean of 1/|x - y| [1/m] over two biweight patches: that of the potential W of one over the other."""
    table = depth_profile()

    def ring(r: float) -> float:
        angle = np.linspace(0.0, math.pi, 201)
        square = (apart**2 + r**2 - 2.0 * apart * r * np.cos(angle)) / radius**2
        mean = np.trapezoid([depth_at(table, float(x)) for x in square], angle) / math.pi
        return 6.0 * r / radius**2 * (1.0 - (r / radius) ** 2) ** 2 * mean / radius

    return quad(ring, 0.0, radius, epsrel=1e-5)[0]


@lru_cache
def surfaces(count: int) -> tuple[Mesh, Mesh]:
    """A fine plane, and a coarse one whose edges are 5 mm long with 600 vertices."""
    return plane(0.05, 10000), plane(0.1, count)


def half_space(count: int, nodes: np.ndarray, forces: np.ndarray, near: float = 0.0) -> tuple[float, float]:
    """Compliance of a half-space [m/N] under a load on a coarse surface, and w. near [1]: vertices that yield by more
    under their load, as next to free walls, over what the half-space has there."""
    fine, coarse = surfaces(count)
    # C is H: what the body has beyond the half-space is 0
    size = len(coarse.vertices)
    body = condensed_body(
        Basis(coarse.vertices, coarse.triangles, np.zeros((3 * size, 3 * size), np.float32)), fine, YOUNG, 0.0, 8e-3,
        0.02, POISSON, sticks=False,
    )  # fmt: skip
    compliance = np.zeros((3 * size, 3 * size), np.float32)
    table = body.model.true.table
    compliance[2::3, 2::3] = NORMAL * (table + near * np.diag(np.diag(table)))
    body = body._replace(model=body.model._replace(compliance=compliance))
    bear(body, 0, nodes, forces, FOOT, UP, 1.0)
    answer(body, np.zeros((1, 5)), 1.0)
    return float(body.contacts[0]["now"]), float(body.contacts[0]["scattered"])


@pytest.mark.parametrize(("count", "least"), [(600, 0.77), (1500, 0.91)])
@pytest.mark.parametrize(("radius", "apart"), [(4e-3, 12e-3), (5e-3, 11e-3), (6e-3, 20e-3)])
def test_the_compliance_under_two_patches_is_that_of_a_half_space(radius, apart, count, least):
    """The coarse vertices are 4.4 and 2.8 mm apart. One patch of the same second moment has less than 0.75."""
    right = NORMAL / YOUNG * (0.5 * MEAN / radius + 0.5 * between(radius, apart))
    for turn in (0.0, 0.5, 1.1):
        end = 0.5 * apart * np.array([math.cos(turn), math.sin(turn)])
        nodes, forces = patches(surfaces(count)[0], [tuple(end), tuple(-end)], radius)
        found, weight = half_space(count, nodes, forces)
        assert weight == 1.0
        assert least * right < found < 1.01 * right
        wide = load_radius(surfaces(count)[0].vertices, nodes, forces, UP, 1.0, LEAST_MOMENT * surfaces(count)[0].areas)
        assert NORMAL / YOUNG * MEAN / wide[0] < 0.75 * right


@pytest.mark.parametrize("radius", [4e-3, 8e-3, 12e-3])
def test_one_patch_has_the_compliance_of_a_biweight_patch(radius):
    for centre in ((0.0, 0.0), (1.3e-3, -2.1e-3)):
        nodes, forces = patches(surfaces(600)[0], [centre], radius)
        found, weight = half_space(600, nodes, forces)
        assert weight == 0.0
        assert found == approx(NORMAL / YOUNG * MEAN / radius, rel=0.01)


@pytest.mark.parametrize("apart", [0.0, 10e-3, 16e-3, 24e-3])
def test_compactness_is_the_area_of_the_patches_over_that_of_one(apart):
    """Two patches of the radius r have the area of one of 2^½ r, and the second moment of one of (r² + d²)^½."""
    mesh, radius = surfaces(600)[0], 5e-3
    nodes, forces = patches(mesh, [(0.5 * apart, 0.0), (-0.5 * apart, 0.0)], radius)
    least = LEAST_MOMENT * mesh.areas
    wide = load_radius(mesh.vertices, nodes, forces, UP, 1.0, least)[0]
    assert wide == approx(math.hypot(radius, apart), rel=0.01)
    right = (2.0 if apart else 1.0) * radius**2 / (radius**2 + apart**2)
    assert compactness(nodes, forces, UP, 1.0, least, wide) == approx(right, rel=0.02)


def test_the_weight_has_no_kink_while_two_patches_part():
    found = []
    for apart in np.linspace(0.0, 8e-3, 161):
        nodes, forces = patches(surfaces(600)[0], [(0.5 * apart, 0.0), (-0.5 * apart, 0.0)], 5e-3)
        found.append(half_space(600, nodes, forces)[0])
    slope = np.diff(found) / found[0]
    assert np.abs(np.diff(slope)).max() < 2e-3
    assert np.abs(slope).max() < 0.02


def test_the_compliance_has_no_jump_where_a_load_reaches_a_vertex():
    """It changed by 0.17 % at once with 2 g - W g limited to the vertices of g, and by 0.03 % elsewhere."""
    found = []
    for way in np.arange(0.0, 1.5e-3, 5e-6):
        nodes, forces = patches(surfaces(600)[0], [(5e-3 + way, 0.4 * way), (-5e-3 + way, 0.4 * way)], 4e-3)
        found.append(half_space(600, nodes, forces, near=0.5)[0])
    change = np.abs(np.diff(found)) / np.mean(found)
    assert np.ptp(found) > 2e-3 * np.mean(found)
    assert change.max() < 5e-4


def test_means_widen_a_load_as_the_hats_do():
    """W of a regular surface keeps the centre and adds the second moment of a hat, h²/4 with edges h, twice: that of
    the mean of phi_u phi_v is 1/12 and 1/6 of the area of each triangle."""
    mesh = plane(0.1, 600)
    means = hat_means(mesh, np.zeros((len(mesh.vertices),) * 2))
    assert means.shares.sum(axis=1) == approx(1.0)
    area = 0.5 * np.linalg.norm(mesh.face_vectors, axis=1)
    v = int(np.argmin(np.linalg.norm(mesh.vertices, axis=1)))
    wanted: dict[int, float] = {}
    for triangle, size in zip(mesh.triangles.tolist(), area, strict=True):
        if v in triangle:
            for u in triangle:
                wanted[u] = wanted.get(u, 0.0) + size * (2.0 if u == v else 1.0)
    total = sum(wanted.values())
    found = dict.fromkeys(means.near[v].tolist(), 0.0)
    for u, share in zip(means.near[v].tolist(), means.shares[v], strict=True):
        found[u] += share
    assert found == {u: approx(each / total) for u, each in wanted.items()}


def test_the_mean_of_widened_loads_is_that_of_the_table_of_means():
    """g.W' T W g of `Means.table`, where W is taken column by column."""
    mesh, rng = plane(0.1, 100), np.random.default_rng(3)
    table = rng.uniform(size=(len(mesh.vertices),) * 2)
    table += table.T
    means, widen = hat_means(mesh, table), np.zeros(table.shape)
    for v in range(len(table)):
        np.add.at(widen[:, v], means.near[v], means.shares[v])
    assert means.table == approx(widen.T @ table @ widen, rel=1e-12)
