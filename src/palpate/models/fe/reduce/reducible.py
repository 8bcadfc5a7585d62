"""Input of a model order reduction: a supported body and the surface on which it is touched."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.models.fe.contact.walls import Walls
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.meshing.fingertip import BONE, DERMIS, EPIDERMIS, NAIL, SUBCUTIS, FingertipDimensions, materials
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.solve.body import ElasticBody, hats
from palpate.models.fe.solve.solver import DEFAULT, Settings, Solver
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.hyperelastic import Material

SUBCUTIS_MODULUS = 6.0 * (300.0 + 671.0)
"""[Pa] Young's modulus at rest of the published subcutis, 6 (c10 + c01), as the finger's modulus E; the other layers
scale with it. The bone is fixed. The published points on steel then need E = 160 Pa, a divisor of 36.4."""


@dataclass
class Reducible:
    """A body whose moduli are proportional to one modulus, and the surface on which it is touched."""

    mesh: TetMesh
    materials: Callable[[float], dict[int, Material]]  # modulus [Pa] -> law of each region
    fixed: np.ndarray  # (N,3) bool, displacements that are zero
    surface: Mesh  # V vertices and triangles, in the body's frame
    hats: np.ndarray  # (N,V) nodal loads of a unit force spread round each vertex of the surface
    supports: Callable[[float], list[ElasticFoundation | Walls]] = lambda young: []  # modulus [Pa] -> linear supports

    @cached_property
    def elastic(self) -> ElasticBody:
        return ElasticBody(self.mesh, self.materials(1.0), self.supports(1.0))

    @cached_property
    def digest(self) -> bytes:
        """Hash of all inputs of its solutions."""
        hasher = hashlib.sha256(self.elastic.digest())
        for part in (self.fixed, self.hats, self.surface.vertices, self.surface.triangles):
            hasher.update(np.ascontiguousarray(part).tobytes())
        return hasher.digest()

    def compliance(self, report: Report = unheard) -> np.ndarray:
        """Displacement of each surface vertex (mean over its hat) for a unit force on each [m/N] (3V,3V)."""
        return self.elastic.compliance(self.fixed, self.hats, report)

    def solver(self, young: float, loads: Callable[[float], np.ndarray], settings: Settings = DEFAULT) -> Solver:
        """Solver of the full model with a modulus [Pa] under nodal loads [N], see `fe.Solver`."""
        return Solver(
            self.mesh, self.materials(young), self.fixed, loads=loads, contacts=self.supports(young), settings=settings
        )


def of_organ(organ: Organ) -> Reducible:
    def supports(young: float) -> list[ElasticFoundation | Walls]:
        on, stiff = organ.resting()
        bed = ElasticFoundation(organ.faces[on], stiff * young)
        pairs = organ.facing
        if pairs is None:
            return [bed]
        stiffness = young * pairs.area * _oedometric(organ.poisson) / pairs.gap  # of a layer of the organ's tissue
        return [bed, Walls(pairs.nodes, pairs.values, pairs.normals, stiffness)]

    free = np.zeros(organ.mesh.points.shape, dtype=bool)
    corners = np.arange(len(organ.surface.vertices))
    touched = organ.faces[(organ.faces[:, :3] < len(corners)).all(axis=1)]
    return Reducible(organ.mesh, organ.materials, free, organ.surface, hats(organ.mesh, touched, corners), supports)


def _oedometric(poisson: float) -> float:
    """Modulus of a layer that cannot expand sideways over Young's modulus [1]."""
    return (1.0 - poisson) / ((1.0 + poisson) * (1.0 - 2.0 * poisson))


def of_finger(finger: FingertipDimensions) -> Reducible:
    """The soft layers of the fingertip, pulp up, tip towards +y, origin on its axis where the rounded tip begins.

    Both halves, fixed at the bone, at the rear and under the nail. The bone is much stiffer than the pulp: a meshed
    instead of a fixed bone changes the indentation by less than 0.1 % up to 0.5 N.
    """
    # mirror the half model
    half, spots = finger.meshed
    across, up, along = finger.upright(spots).T
    placed = np.stack([across, along - finger.phalanx, -up], axis=1)
    away = np.abs(across) > 1e-9
    count = len(half.points)
    other = np.arange(count)
    other[away] = count + np.arange(away.sum())
    points = np.concatenate([placed, placed[away] * (-1.0, 1.0, 1.0)])
    turned = half.elements[:, [1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]  # a mirrored element with two corners swapped
    region = np.tile(half.region, 2)
    whole = TetMesh(points, np.concatenate([half.elements, other[turned]]), region)
    # fixed nodes; the skin without rear and nail
    held = np.concatenate([finger.held, finger.held[away]])
    held[np.unique(whole.elements[region == BONE])] = True
    faces = whole.boundary(np.flatnonzero(region != NAIL))
    rear = (whole.points[faces[:, :3], 1] < -finger.phalanx * (1.0 - 1e-6)).all(axis=1)
    # keep the soft layers
    soft = np.isin(region, (SUBCUTIS, DERMIS, EPIDERMIS))
    nodes, elements = np.unique(whole.elements[soft], return_inverse=True)
    number = np.full(len(points), -1)
    number[nodes] = np.arange(len(nodes))
    mesh = TetMesh(whole.points[nodes], elements.reshape(-1, 10), region[soft])
    skin = number[faces[~rear]]
    corners, triangles = np.unique(skin[:, :3], return_inverse=True)
    surface = Mesh(mesh.points[corners], triangles.reshape(-1, 3).astype(np.int32))
    fixed = np.repeat(held[nodes][:, None], 3, axis=1)

    def laws(young: float) -> dict[int, Material]:
        return {region: replace(law, mixed=False) for region, law in materials(SUBCUTIS_MODULUS / young).items()}

    return Reducible(mesh, laws, fixed, surface, hats(mesh, skin, corners))
