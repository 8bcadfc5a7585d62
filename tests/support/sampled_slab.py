"""The slab of the tests of sampled bodies: its full model, touches of it, and its basis, each computed once."""

from functools import cache

import numpy as np
from pressing import SampledBody

from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce.reducible import of_organ
from palpate.models.fe.reduce.reduction import build
from palpate.models.fe.reduce.sampling import modes
from palpate.models.fe.reduce.snapshots import MILD, press_from_rest, scatter
from palpate.nodes.base.surface import surface_mesh

YOUNG = 2e4
TOUCHES, MODES = 12, 16
HELD = {12: 3, 28: 6, 42: 6}
"""Number of held-out touches by total number."""
RADIUS = 12e-3
UP = (0.0, 0.0, 1.0)


@cache
def slab():
    return of_organ(Organ(surface_mesh("plane", 80)))


def touches(count=TOUCHES, seed=3):
    surface = slab().surface
    middle = surface.vertices[surface.triangles].mean(axis=1)
    inner = np.abs(middle).max(axis=1) < 0.026
    return scatter(surface, count, inner, RADIUS, 1.5 * RADIUS**2 * MILD, seed)


@cache
def _pressed(count):
    return press_from_rest(slab(), touches(count))


def pressed(count=TOUCHES):
    """Full solutions of this number of touches."""
    return _pressed(count)


@cache
def mode_shapes():
    """The modes (N,3,r) of the basis."""
    return modes(slab(), pressed()[: -HELD[TOUCHES]], MODES)[0]


@cache
def _basis(count, of):
    return build(slab(), pressed(of)[: -HELD[of]], pressed(of)[-HELD[of] :], count, tolerance=3e-3)


def basis(count=MODES, of=TOUCHES):
    """The basis with this number of modes and points, from this number of touches."""
    return _basis(count, of)


@cache
def compliance():
    return slab().compliance()


def body(retardation=0.0, count=MODES, of=TOUCHES):
    return SampledBody(basis(count, of), slab().surface, YOUNG, retardation, RADIUS, 1.0)


def at(place=(0.0, 0.0, 0.0), radius=RADIUS, mesh=None):
    """Foot point, normal, nodes and unit forces of a load on the slab."""
    mesh = mesh or slab().surface
    q = np.linalg.norm(mesh.vertices - place, axis=1) / radius
    nodes = np.flatnonzero(q < 1).astype(np.int32)
    share = (1 - q[nodes] ** 2) ** 2
    return tuple(place), UP, nodes, np.outer(share / share.sum(), (0, 0, -1.0))
