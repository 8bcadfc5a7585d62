"""The pressure that ReducedFE sends, compared with the stress in full finite elements just below the surface."""

import numpy as np
import pytest
from pressing import Spreader
from scipy.interpolate import CloughTocher2DInterpolator

from palpate.messages import Load
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.element.mesh import EDGES
from palpate.models.fe.solve.solver import Solver
from palpate.nodes.deformation import ReducedFE
from palpate.physics.materials.neo_hooke import neo_hooke
from palpate.studies.peers.continuum import BED, POISSON, STEPS, YOUNG, TissueBlock, tetrahedra

UP = (0.0, 0.0, 1.0)
RINGS = 5
HATS = np.stack([1.0 - face_rule.POINTS.sum(axis=1), *face_rule.POINTS.T], axis=1)


def displacement_gradient(mesh, face, u):
    """(F,6,3,3) at the integration points of faces, from their quadratic tetrahedra."""
    corners = np.sort(mesh.elements[:, :4], axis=1)
    owner = {}
    for left_out in range(4):
        for e, three in enumerate(np.delete(corners, left_out, axis=1)):
            owner[tuple(three)] = e
    element = mesh.elements[[owner[tuple(sorted(one))] for one in face[:, :3]]]
    points = mesh.points[element[:, :4]]
    edges = np.concatenate([np.ones((len(points), 4, 1)), points], axis=2)
    slope = np.linalg.inv(edges)[:, 1:]  # of the barycentric coordinates (F,3,4)
    at = np.einsum("qa,fai->fqi", HATS, mesh.points[face[:, :3]])
    one = np.concatenate([np.ones((*at.shape[:2], 1)), at], axis=2)
    share = np.einsum("fqi,fia->fqa", one, np.linalg.inv(edges))
    gradient = np.empty((*at.shape[:2], 10, 3))
    gradient[:, :, :4] = (4.0 * share - 1.0)[..., None] * slope.transpose(0, 2, 1)[:, None]
    for k, (i, j) in enumerate(EDGES):
        first, second = slope[:, None, :, j], slope[:, None, :, i]
        gradient[:, :, 4 + k] = 4.0 * (share[..., i, None] * first + share[..., j, None] * second)
    return np.einsum("fai,fqaj->fqij", u[element], gradient)


class Layered(TissueBlock):
    """A block with layers of 1/8, 1/8, 1/4 and 1/2 of a cell below the top, where the stress is evaluated."""

    def axes(self):
        x, y, z = super().axes()
        cell = z[-1] - z[-2]
        return x, y, np.concatenate([z[:-1], [-cell / 2, -cell / 4, -cell / 8, 0.0]])


def traction(block, force):
    """Points of the top [m] (Q,2), the pressure there [Pa] (Q,) from the neo-Hookean stress of the solved displacement,
    per area at rest, and the area [m²] (Q,) of each point."""
    cut = tetrahedra(block)
    bed = ElasticFoundation(cut.under, BED * YOUNG)
    law = {0: neo_hooke(YOUNG, POISSON)}
    body = Solver(cut.mesh, law, cut.fixed, loads=lambda f: 0.5 * f * cut.unit, contacts=[bed], settings=STEPS)
    body.advance(force)
    mesh = cut.mesh
    corner = mesh.points[mesh.faces[:, :3]]
    near = np.hypot(corner[..., 0] - block.place, corner[..., 1]).min(axis=1) < 2.0 * block.radius
    face = mesh.faces[(corner[..., 2] > -1e-9).all(axis=1) & near]
    F = np.eye(3) + displacement_gradient(mesh, face, body.displacement)
    J, away = np.linalg.det(F), np.linalg.inv(F).swapaxes(-1, -2)
    shear, bulk = YOUNG / (2.0 * (1.0 + POISSON)), YOUNG / (3.0 * (1.0 - 2.0 * POISSON))
    J = J[..., None, None]
    square = np.sum(F * F, axis=(-2, -1), keepdims=True)
    P = shear * J ** (-2.0 / 3.0) * (F - square / 3.0 * away) + bulk * (J - 1.0) * J * away
    at = np.einsum("qa,fai->fqi", HATS, mesh.points[face[:, :3]])
    return at[..., :2].reshape(-1, 2), -P[..., 2, 2].ravel(), face_rule.areas(mesh.points, face).ravel()


@pytest.mark.parametrize(
    ("place", "radius", "force"), [(0.0, 8e-3, 0.5), pytest.param(0.025, 5e-3, 0.03, marks=pytest.mark.long)]
)
def test_the_pressure_equals_that_of_full_elements_under_the_patch(place, radius, force):
    """The means over rings of width 0.2 R are compared, because the elements' stress scatters from point to point."""
    node = ReducedFE(surface="plane", position=(0.0, 0.0, 0.0), vertices=10000, retardation=0.0)
    node.start()
    spreader, foot = Spreader(node.mesh(), radius), (place, 0.0, 0.0)
    count = spreader.spread(foot, UP, (0.0, 0.0, -force))
    nodes, forces = spreader.nodes[:count].copy(), spreader.forces[:count].copy()
    surface = node.step([Load(nodes=nodes, forces=forces, foot=foot, normal=UP)], dt=1e-3)
    points, right, area = traction(Layered(place, 3, radius=radius), force)
    ring = (RINGS * np.hypot(points[:, 0] - place, points[:, 1]) / radius).astype(int)
    under = ring < RINGS
    shown = CloughTocher2DInterpolator(node.mesh().vertices[surface.nodes, :2], surface.pressure)(points[under])
    off, ring, area = shown - right[under], ring[under], area[under]
    peak = surface.pressure.max()
    by_ring = np.bincount(ring, area * off) / np.bincount(ring, area) / peak
    assert np.sqrt(np.mean(by_ring**2)) < 0.015 and np.abs(by_ring).max() < 0.03
    assert np.sqrt(np.average(off**2, weights=area)) < 0.05 * peak
