"""Checks of a model before the solution: units, locking, support, shapes of user functions."""

from collections.abc import Iterable, Mapping

import numpy as np

from palpate.models.fe.element.mesh import MeshError, TetMesh
from palpate.models.fe.solve.support import pieces
from palpate.physics.materials.hyperelastic import PLAIN_UP_TO, Material, MaterialError, poisson_of, rest_moduli

SMALLEST, LARGEST = 1e-5, 4.0  # [m] Limits of a mesh's diagonal; beyond them the unit is wrong
SOFTEST, STIFFEST = 50.0, 2e12
"""[Pa] Limits of Young's modulus: below the softest tissue (a value in kPa would be lower), above diamond."""


def check_units(mesh: TetMesh, materials: Mapping[int, Material]) -> None:
    """MeshError, MaterialError: lengths are not in metres, or moduli not in pascals."""
    if not SMALLEST <= mesh.size <= LARGEST:
        raise MeshError(
            f"mesh: {mesh.size:.4g} m across, expected {SMALLEST:g} ... {LARGEST:g} m. Points are in metres: for "
            "a mesh in millimetres use points * 1e-3"
        )
    for region in np.unique(mesh.region).tolist():
        E = young(materials[region])
        if not SOFTEST <= E <= STIFFEST:
            raise MaterialError(
                f"region {region}: Young's modulus {E:.4g} Pa, expected {SOFTEST:g} ... {STIFFEST:g} Pa. Moduli "
                f"are in pascals: {E:.4g} kPa is {1e3 * E:.4g} Pa, {E:.4g} MPa is {1e6 * E:.4g} Pa"
            )


def check_locking(mesh: TetMesh, materials: Mapping[int, Material]) -> None:
    """MaterialError: plain elements of a nearly incompressible material, which lock."""
    for region in np.unique(mesh.region).tolist():
        material = materials[region]
        ratio = poisson_of(*rest_moduli(material))
        if not material.mixed and ratio > PLAIN_UP_TO + 1e-9:
            raise MaterialError(
                f"region {region}: plain elements at a Poisson's ratio of {ratio:.6g}, where they lock; expected at "
                f"most {PLAIN_UP_TO:g}. Use the mixed element: `Material(..., mixed=True)`"
            )


def young(material: Material) -> float:
    """Young's modulus of the undeformed material [Pa]. MaterialError: see `rest_moduli`."""
    shear, bulk = rest_moduli(material)
    return 9.0 * bulk * shear / (3.0 * bulk + shear)


def check_held(mesh: TetMesh, fixed: np.ndarray, touched: Iterable[np.ndarray]) -> None:
    """MeshError: a connected piece of the mesh without fixed (N,3) nodes and without contact."""
    piece = pieces(mesh)
    held: np.ndarray = np.asarray(fixed.any(axis=1))
    for nodes in touched:
        if nodes.size and (nodes.min() < 0 or nodes.max() >= len(held)):
            raise MeshError(f"contact: a face refers to node {nodes.max()}, the mesh has {len(held)}")
        held[nodes] = True
    used = piece[mesh.elements[:, 0]]
    loose = ~np.isin(used, piece[held])
    if not loose.any():
        return
    bad = int(np.argmax(loose))
    elements = mesh.elements[used == used[bad]]
    at = mesh.points[elements[:, :4]].mean(axis=(0, 1))
    _, same = np.unique(np.round(mesh.points / (1e-9 * mesh.size)), axis=0, return_counts=True)
    raise MeshError(
        f"the piece of {len(elements)} elements around ({at[0]:.4g}, {at[1]:.4g}, {at[2]:.4g}) m has no support: none "
        f"of its nodes is fixed or in contact. Fix some of it, or join it to the rest: {int((same > 1).sum())} places "
        "of the mesh hold more than one node"
    )


def checked(what: str, values: np.ndarray, load: float, wanted: np.ndarray) -> np.ndarray:
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
