"""The compliance under the patch of a load on a body condensed to coarse vertices (physics.bodies.true_patch)."""

import math
from functools import lru_cache
from itertools import pairwise

import numpy as np
import pytest
from pressing import CondensedBody, Spreader
from pytest import approx
from scipy.integrate import quad
from scipy.special import ellipe, ellipk

from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.deformation import ReducedFE
from palpate.physics.bodies import hat_distances
from palpate.physics.bodies import true_patch as tp
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.geometry.mesh import Mesh, plane
from palpate.studies.accuracy.bases import ready
from palpate.studies.accuracy.sites import load_reference

YOUNG, POISSON, RADIUS = 19e3, 0.45, 8e-3
UP = (0.0, 0.0, 1.0)


def pressure(s):
    return 3.0 / math.pi * (1.0 - s * s) ** 2


def potential(rho):
    """Potential of the pressure on a disc of radius 1, by rings: K is the complete elliptic integral."""

    def ring(s):
        return pressure(s) * s * 4.0 / (rho + s) * ellipk(4.0 * rho * s / (rho + s) ** 2)

    cuts = [0.0, min(rho, 1.0), 1.0]
    return sum(quad(ring, a, b, limit=200)[0] for a, b in pairwise(cuts) if b > a)


@pytest.mark.parametrize("rho", [0.0, 0.1, 0.5, 0.97, 1.2, 2.5, 5.0, 9.0, 40.0])
def test_the_displacement_of_a_half_space_is_the_potential_of_the_pressure(rho):
    assert tp.depth_at(tp.depth_profile(), rho * rho) == approx(potential(rho), rel=1e-4)


def test_the_compliance_of_the_half_space_is_the_mean_of_its_displacement():
    mean = quad(lambda s: 2.0 * math.pi * s * pressure(s) * potential(s), 0.0, 1.0, epsabs=1e-8)[0]
    assert mean == approx(tp.MEAN, rel=1e-6)


def test_the_compliance_reduction_by_sticking_equals_a_ring_model():
    """Radial traction on narrow rings instead of a series cancels F(r)/(2 pi r) inside; compared is its work."""
    n, parts = 120, 10
    edges = np.sin(np.linspace(0.0, math.pi / 2, n + 1))  # finer towards the rim, where the traction is unbounded
    r = 0.5 * (edges[1:] + edges[:-1])
    wanted = (1.0 - (1.0 - r**2) ** 3) / (2.0 * math.pi * r)
    response, middle = np.zeros((n, n)), r
    for j in range(n):  # integral of J1(k r) J1(k s) over k, as for the vector potential of a current loop
        for s in edges[j] + np.diff(edges)[j] * (np.arange(parts) + 0.5) / parts:
            m = 4.0 * r * s / (r + s) ** 2
            ring = ((r * r + s * s) * ellipk(m) - (r + s) ** 2 * ellipe(m)) / (math.pi * r * s * (r + s))
            response[:, j] += s * np.diff(edges)[j] / parts * ring
    traction = np.linalg.solve(response, wanted)
    work = 2.0 * math.pi * np.sum(middle * np.diff(edges) * wanted * traction)
    assert 0.5 * math.pi * work / tp.MEAN == approx(tp.HELD, rel=0.02)


def test_the_mean_inverse_distance_over_a_square_is_known():
    mesh = plane(1.0, 150)
    mass = mesh.areas
    table = hat_distances.mean_inverse_distance(mesh)
    exact = 4.0 * math.log(1.0 + math.sqrt(2.0)) - 4.0 / 3.0 * (math.sqrt(2.0) - 1.0)
    assert mass @ table @ mass == approx(exact, rel=2e-4)
    assert (table == table.T).all() and np.linalg.eigvalsh(table)[0] > 0.0


def test_hat_integrals_agree_with_points_far_apart_and_monte_carlo_nearby():
    mesh = plane(1.0, 100)
    table = hat_distances.mean_inverse_distance(mesh)
    away = np.linalg.norm(mesh.vertices[:, None] - mesh.vertices[None], axis=2)
    inner = (np.abs(mesh.vertices[:, :2]) < 0.49).all(axis=1)
    far = (away > 0.6) & inner & inner[:, None]
    assert table[far] == approx(1.0 / away[far], rel=0.02)
    v = int(np.linalg.norm(mesh.vertices, axis=1).argmin())
    rng = np.random.default_rng(3)

    def drawn(count):
        own = mesh.triangles[(mesh.triangles == v).any(axis=1)]
        corner = mesh.vertices[own]
        area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
        chosen = rng.choice(len(own), count, p=area / area.sum())
        shares = rng.dirichlet([1.0, 1.0, 1.0], count)
        hat = shares[own[chosen] == v]
        return np.einsum("kc,kci->ki", shares, corner[chosen]), hat

    (x, p), (y, q) = drawn(400_000), drawn(400_000)
    mean = np.sum(p * q / np.linalg.norm(x - y, axis=1)) / np.sum(p * q)
    assert table[v, v] == approx(mean, rel=0.01)


def slab_body(poisson=POISSON, vertices=10000, **more):
    node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=vertices, model="linear")
    return CondensedBody(node.basis(), node.mesh(), YOUNG, 0.0, RADIUS, 1.0, poisson, **more)


def pressed(body, place, force=0.1, radius=RADIUS):
    spreader = Spreader(body.mesh, radius)
    count = spreader.spread((place, 0.0, 0.0), UP, (0.0, 0.0, -force))
    nodes, forces = spreader.nodes[:count].copy(), spreader.forces[:count].copy()
    law = body.step(nodes, forces, (place, 0.0, 0.0), UP, 1.0)
    return law, nodes, forces


@pytest.mark.parametrize(("name", "error"), [("middle", 0.012), ("slip", 0.012), ("edge", 0.025)])
def test_a_light_touch_of_a_slab_agrees_with_two_full_solvers(name, error):
    """The references are computed with fe.Solver and FElupe on meshes that follow the patch."""
    reference = load_reference(name)
    soft = np.polyfit(reference.force[:4], reference.indentation[:4] / reference.force[:4], 2)[-1]
    sticks = reference.about["place"].get("sticks", True)
    (compliance, _, _), _, _ = pressed(slab_body(sticks=sticks), reference.about["place"]["place"])
    assert compliance == approx(soft, rel=error)
    (widened, _, _), _, _ = pressed(slab_body(None), reference.about["place"]["place"])
    assert widened < 0.9 * soft


def test_the_result_hardly_depends_on_the_patch_position_between_vertices():
    body, rng = slab_body(), np.random.default_rng(5)
    found = []
    for x, y in rng.uniform(-6e-3, 6e-3, (30, 2)):
        spreader = Spreader(body.mesh, RADIUS)
        count = spreader.spread((x, y, 0.0), UP, (0.0, 0.0, -0.1))
        found.append(body.step(spreader.nodes[:count], spreader.forces[:count], (x, y, 0.0), UP, 1.0)[0])
    assert np.std(found) < 2e-3 * np.mean(found)


def test_the_mean_sent_displacement_under_the_load_is_the_indentation():
    body = slab_body()
    for place in (0.0, 0.04):
        (_, _, now), nodes, forces = pressed(body, place, 0.3)
        sent, moved = body.displaced((place, 0.0, 0.0))
        field = np.zeros((len(body.mesh.vertices), 3))
        field[sent] = moved
        assert np.sum(forces * field[nodes]) / 0.3 == approx(now, rel=0.01)


def test_the_sent_surface_agrees_with_two_full_solvers():
    reference, body = load_reference("middle"), slab_body()
    k = 3
    pressed(body, 0.0, reference.force[k])
    sent, moved = body.displaced((0.0, 0.0, 0.0))
    assert len(sent) == len(body.mesh.vertices)
    flat = body.mesh.vertices[sent]
    line = (np.abs(flat[:, 1]) < 6e-4) & (np.abs(flat[:, 0]) < 20e-3)
    column = int(np.abs(reference.y).argmin())
    exact = np.interp(flat[line, 0], reference.x, reference.shape[k][:, column])
    assert np.abs(-moved[line, 2] - exact).max() < 0.03 * exact.max()


def test_a_sticking_patch_keeps_its_mean_position_and_a_free_one_moves():
    """At the border of the slab a press pushes the surface outwards."""
    place = 0.04
    drift = {}
    for sticks in (True, False):
        body = slab_body(sticks=sticks)
        (compliance, _, now), nodes, forces = pressed(body, place, 0.3)
        sent, moved = body.displaced((place, 0.0, 0.0))
        field = np.zeros((len(body.mesh.vertices), 3))
        field[sent] = moved
        share = -forces[:, 2] / 0.3
        drift[sticks] = (share @ field[nodes][:, 0] / now, compliance)
    assert abs(drift[True][0]) < 0.3 * abs(drift[False][0]) and abs(drift[False][0]) > 0.1
    assert drift[True][1] < 0.97 * drift[False][1]


def hats(mesh):
    """Points [m] (Q,3) on the triangles of a mesh, and their weights in the average under each vertex's hat (Q,V)."""
    corner = mesh.vertices[mesh.triangles]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    points = np.einsum("qc,tci->tqi", hat_distances.RULE[:, :3], corner)
    counts = np.zeros((*points.shape[:2], len(mesh.vertices)))
    for c in range(3):
        each = area[:, None] * hat_distances.RULE[:, 3] * hat_distances.RULE[:, c]
        np.put_along_axis(counts, np.repeat(mesh.triangles[:, None, c : c + 1], 7, 1), each[..., None], 2)
    counts = counts.reshape(-1, len(mesh.vertices))
    return points.reshape(-1, 3), counts / counts.sum(axis=0)


STIFFER, WIDTH = 0.3, 9e-3
"""[1] Share of the compliance that a harder lump removes at its centre, and [m] its width w: between two points at x
and y it removes the fraction exp(-x²/w²) exp(-y²/w²)."""


@lru_cache(maxsize=1)
def lumped():
    """A half-space with the lump, condensed to hats 4 mm apart."""
    coarse = plane(0.1, 600)
    points, counts = hats(coarse)
    felt = counts.T @ np.exp(-np.sum(points**2, axis=1) / WIDTH**2)
    taken = STIFFER * (1.0 - POISSON**2) * tp.MEAN / (math.pi * RADIUS) * np.outer(felt, felt)
    half_space = (1.0 - POISSON**2) / math.pi * hat_distances.mean_inverse_distance(coarse)
    size = len(coarse.vertices)
    compliance = np.zeros((size, 3, size, 3))
    compliance[:, 2, :, 2] = half_space - taken
    compliance[:, 0, :, 0] = compliance[:, 1, :, 1] = half_space
    return Basis(coarse.vertices, coarse.triangles, compliance.reshape(3 * size, -1).astype(np.float32))


def lumped_body(apart):
    near = None if apart is None else np.full(len(lumped().vertices), apart)
    return CondensedBody(lumped(), plane(0.1, 10000), YOUNG, 0.0, RADIUS, 1.0, POISSON, False, near)


def test_over_a_lump_the_load_acts_with_its_width():
    """Compared with the quadrature of the pressure on the half-space and the lump."""
    mean = quad(lambda s: 2.0 * math.pi * s * pressure(s) * math.exp(-((s * RADIUS / WIDTH) ** 2)), 0.0, 1.0)[0]
    exact = (1.0 - POISSON**2) * tp.MEAN / (math.pi * RADIUS * YOUNG) * (1.0 - STIFFER * mean * mean)
    (over, _, now), nodes, forces = pressed(body := lumped_body(0.0), 0.0)
    assert over == approx(exact, rel=0.006)
    sent, moved = body.displaced((0.0, 0.0, 0.0))
    field = np.zeros((len(body.mesh.vertices), 3))
    field[sent] = moved
    assert np.sum(forces * field[nodes]) / 0.1 == approx(now, rel=0.015)
    assert pressed(lumped_body(None), 0.0)[0][0] > 1.02 * exact


def test_the_width_correction_decays_away_from_a_nodule():
    found = [pressed(lumped_body(far * RADIUS), 0.0)[0][0] for far in (0.2, 0.45, 1.0, 1.7, 2.05)]
    assert found[0] == found[1] < found[2] < found[3] < found[4]
    assert found[4] == pressed(lumped_body(None), 0.0)[0][0]


def test_the_correction_near_a_nodule_is_the_same_for_every_load():
    body = lumped_body(RADIUS)
    found = [pressed(body, 0.004, force)[0][0] for force in (0.01, 1.0, 0.2)]
    assert found == approx([found[0]] * 3, rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(("name", "error"), [("nodule-00", 0.025), ("nodule-10", 0.02)])
def test_a_light_touch_of_a_slab_with_a_nodule_agrees_with_two_full_solvers(name, error, nodule_node):
    reference = load_reference(name)
    soft = np.polyfit(reference.force[:4], reference.indentation[:4] / reference.force[:4], 2)[-1]
    body = CondensedBody.of(nodule_node)
    assert pressed(body, reference.about["place"]["place"])[0][0] == approx(soft, rel=error)


@pytest.fixture(scope="module")
def nodule_node(tmp_path_factory):
    """The slab of the references with its nodule, with a built basis."""
    nodule = {"nodule_depth": 6e-3, "nodule_radius": 4e-3, "nodule_ratio": 10.0}
    place = {"surface": "plane", "position": (0.0, 0.0, 0.0), "vertices": 10000}
    node = ReducedFE(**place, **nodule, model="linear", retardation=0.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        ready(node)
        yield node


def softness(body, radius):
    """Compliance, and radius of the pressed patch on the mesh."""
    (compliance, _, _), nodes, forces = pressed(body, 0.0, 0.1, radius)
    square = np.sum(-forces[:, 2] / 0.1 * np.sum(body.mesh.vertices[nodes] ** 2, axis=1))
    return compliance, 2.0 * math.sqrt(square)


def test_the_compliance_is_inverse_to_the_radius_down_to_the_mesh_size():
    body = slab_body(vertices=10000)
    (wide, far), (narrow, near) = (softness(body, radius) for radius in (8e-3, 4e-3))
    half_space = (1.0 - POISSON**2) * tp.MEAN * (1.0 - tp.HELD * (0.1 / 0.55) ** 2) / (math.pi * YOUNG)
    assert narrow - wide == approx(half_space * (1.0 / near - 1.0 / far), rel=0.06)  # and the contribution of the slab
    assert body.extrapolation == 0.0
    pressed(body, 0.0, 0.1, 0.5e-3)
    assert 0.0 < body.extrapolation < 14.0


def test_energy_is_positive_for_any_position_poisson_ratio_and_load():
    """V* = h.Ch/2E + more y²/2 is convex if `more` is not negative; if it is, c must be above 0."""
    mesh, rng = surface_mesh("kidney", 3000), np.random.default_rng(8)
    basis = ReducedFE(model="linear").basis()
    coarse = Mesh(basis.vertices, basis.triangles)
    for poisson, apart in ((0.0, None), (0.3, 0.0), (0.3, None), (0.45, 0.0), (0.45, None), (0.49, 0.0)):
        near = None if apart is None else np.full(len(basis.vertices), apart)
        body = CondensedBody(basis, mesh, YOUNG, 0.0, RADIUS, 0.02, poisson, apart=near)
        for v in rng.choice(len(mesh.vertices), 12):
            foot, normal = mesh.vertices[v], mesh.normals[v] / np.linalg.norm(mesh.normals[v])
            for radius in (3e-3, 8e-3, 15e-3):
                spreader = Spreader(mesh, radius)
                count = spreader.spread(tuple(foot), tuple(normal), tuple(-0.2 * normal))
                law = body.step(spreader.nodes[:count], spreader.forces[:count], tuple(foot), tuple(normal), 1.0)
                assert law[0] > 0.0 and math.isfinite(law[2]) and law[2] > 0.0
    assert len(coarse.vertices) == len(basis.vertices)
