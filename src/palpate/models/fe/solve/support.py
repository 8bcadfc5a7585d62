"""Checks of a model: units, locking, shapes of user functions; fixed nodes or loaded contacts prevent rigid motion."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element.mesh import MeshError, TetMesh, point_text
from palpate.models.fe.sparse.tangent import Pattern
from palpate.physics.materials.hyperelastic import PLAIN_UP_TO, Material, MaterialError, poisson_of, rest_moduli

SMALLEST, LARGEST = 1e-5, 4.0  # [m] Limits of a mesh's diagonal; beyond them the unit is wrong
SOFTEST, STIFFEST = 50.0, 2e12
"""[Pa] Limits of Young's modulus: below the softest tissue (a value in kPa would be lower), above diamond."""
FIXED = 1e-12  # [1] Relative stiffness of a rigid motion above which fixed components prevent it; below is rounding
HELD = 1e-8  # [1] The same for contacts; a contact of 0.1 % of the size of the body still prevents rotation
CARRIED = 1e-11  # [1] Force of the contacts over stiffness times size of the body, below which they are unloaded


def check_materials(mesh: TetMesh, materials: Mapping[int, Material]) -> None:
    """MeshError, MaterialError: lengths not in metres, moduli not in pascals, or plain elements of a nearly
    incompressible material, which lock."""
    if not SMALLEST <= mesh.size <= LARGEST:
        raise MeshError(
            f"mesh: {mesh.size:.4g} m across, expected {SMALLEST:g} ... {LARGEST:g} m. Points are in metres: for "
            "a mesh in millimetres use points * 1e-3"
        )
    for region in np.unique(mesh.region).tolist():
        material = materials[region]
        shear, bulk = rest_moduli(material)
        E, ratio = 9.0 * bulk * shear / (3.0 * bulk + shear), poisson_of(shear, bulk)
        if not SOFTEST <= E <= STIFFEST:
            raise MaterialError(
                f"region {region}: Young's modulus {E:.4g} Pa, expected {SOFTEST:g} ... {STIFFEST:g} Pa. Moduli "
                f"are in pascals: {E:.4g} kPa is {1e3 * E:.4g} Pa, {E:.4g} MPa is {1e6 * E:.4g} Pa"
            )
        if not material.mixed and ratio > PLAIN_UP_TO + 1e-9:
            raise MaterialError(
                f"region {region}: plain elements at a Poisson's ratio of {ratio:.6g}, where they lock; expected at "
                f"most {PLAIN_UP_TO:g}. Use the mixed element: `Material(..., mixed=True)`"
            )


def check_values(what: str, values: np.ndarray, load: float, wanted: np.ndarray) -> np.ndarray:
    """Values of a user's function of the load, zero outside the mask `wanted` (N,3). ValueError: wrong shape, or values
    that are not finite."""
    values = np.asarray(values, dtype=np.float64)
    if values.shape != wanted.shape:
        raise ValueError(f"{what} at load {load:.6g}: found shape {values.shape}, expected {wanted.shape}")
    values = np.where(wanted, values, 0.0)
    if not np.isfinite(values).all():
        node = int(np.argwhere(~np.isfinite(values))[0][0])
        raise ValueError(f"{what} at load {load:.6g}: the value at node {node} is not finite")
    return values


class Support:
    """Rigid motions of the connected pieces of a mesh that the fixed components (N,3) bool leave free.

    MeshError: a piece without fixed nodes and without nodes that contacts may touch.
    """

    def __init__(self, mesh: TetMesh, fixed: np.ndarray, touched: Iterable[np.ndarray]) -> None:
        many = mesh.elements.shape[1]
        links = np.repeat(mesh.elements[:, 0], many), mesh.elements.ravel()
        coupled = coo_array((np.ones(mesh.elements.size, dtype=np.int8), links), shape=(len(mesh.points),) * 2)
        self.mesh, self._piece = mesh, connected_components(coupled, directed=False)[1]
        self._check(fixed, touched)
        motions = []
        for piece in np.unique(self._piece[mesh.elements[:, 0]]).tolist():
            rigid = _rigid(mesh.points, self._piece == piece)
            held = rigid[fixed]
            value, vector = np.linalg.eigh(held.T @ held)
            motions.append(rigid @ vector[:, value <= FIXED * max(value[-1], 1.0)])
        self.free = np.concatenate(motions, axis=2).reshape(mesh.points.size, -1)  # Displacements (3N,k), at most 1

    def _check(self, fixed: np.ndarray, touched: Iterable[np.ndarray]) -> None:
        mesh, held = self.mesh, np.asarray(fixed.any(axis=1))
        for nodes in touched:
            if nodes.size and (nodes.min() < 0 or nodes.max() >= len(held)):
                raise MeshError(f"contact: a face refers to node {nodes.max()}, the mesh has {len(held)}")
            held[nodes] = True
        loose = ~np.isin(self._piece[mesh.elements[:, 0]], self._piece[held])
        if loose.any():
            _, same = np.unique(np.round(mesh.points / (1e-9 * mesh.size)), axis=0, return_counts=True)
            piece = self._piece_name(self._piece[mesh.elements[np.argmax(loose), 0]])
            raise MeshError(
                f"{piece} has no support: none of its nodes is "
                f"fixed or in contact. Fix some of it, or join it to the rest: {int((same > 1).sum())} places of the "
                "mesh hold more than one node"
            )

    def _piece_name(self, piece: int) -> str:
        elements = self.mesh.elements[self._piece[self.mesh.elements[:, 0]] == piece]
        at = point_text(self.mesh.points[elements[:, :4]].mean(axis=(0, 1)))
        return f"the piece of {len(elements)} elements around {at}"

    def adrift(self, u: np.ndarray, load: float, contacts: Sequence[ContactPair], pattern: Pattern) -> str:
        """Description of a rigid motion without resistance of a body in equilibrium, or "".

        Contacts prevent a motion if they carry a force and their stiffness against it is positive.
        """
        if not self.free.shape[1]:
            return ""
        force, data = np.zeros_like(u), np.zeros((len(pattern.indices), 3, 3))
        for contact in contacts:
            contact.add(u, load, True, force, data)
        matrix = pattern.matrix(data)
        stiffness = float(np.abs(matrix.diagonal()).sum())
        value, vector = np.linalg.eigh(self.free.T @ (matrix @ self.free))
        carried = np.linalg.norm(force) > CARRIED * stiffness * self.mesh.size
        if carried and value[0] > HELD * stiffness:
            return ""
        return self._describe_motion((self.free @ vector[:, 0]).reshape(-1, 3), bool(carried))

    def _describe_motion(self, motion: np.ndarray, carried: bool) -> str:
        piece = self._piece[np.argmax(np.linalg.norm(motion, axis=1))]
        rigid = _rigid(self.mesh.points, self._piece == piece).reshape(motion.size, 6)
        part = np.linalg.lstsq(rigid, motion.ravel())[0]
        shift, turn = part[:3], part[3:]
        straight = np.linalg.norm(shift) >= np.linalg.norm(turn)
        along = np.round((shift if straight else turn) / np.linalg.norm(shift if straight else turn), 2) + 0.0
        goes = f"{'moving along' if straight else 'turning about'} ({along[0]:g}, {along[1]:g}, {along[2]:g})"
        why = "its contacts carry a force, but not against this" if carried else "no contact carries a force"
        return (
            f"nothing holds {self._piece_name(piece)} against {goes}: {why}. Fix some of its nodes, support it with an "
            "`ElasticFoundation`, or press it from all sides, with friction where it may slide"
        )


def _rigid(points: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """Rigid motions (N,3,6) of the nodes (N,) bool: three translations, three rotations about their mean position.

    Displacements are at most 1, and 0 at the other nodes.
    """
    arm = points - points[nodes].mean(axis=0)
    arm /= np.linalg.norm(arm[nodes], axis=1).max()
    motions = np.zeros((*points.shape, 6))
    for k, axis in enumerate(np.eye(3)):
        motions[nodes, :, k] = axis
        motions[nodes, :, 3 + k] = np.cross(axis, arm[nodes])
    return motions
