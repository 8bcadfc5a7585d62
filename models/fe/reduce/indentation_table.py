"""The nonlinear correction of the linear organ, place by place: the table of `physics.bodies.indentation_table`.

The full model is pressed at scattered places (`fe.indent`), every time to the same indentations over the radius of the
patch; between the places its values are carried over the surface by a spline.
"""

import numpy as np
from scipy.sparse import csr_array, kron

from palpate.models.fe.element import faces as face_rule
from palpate.models.fe.progress import Report, unheard
from palpate.models.fe.reduce.indentation import OrganPress, PressCurve
from palpate.models.fe.reduce.reducible import Reducible
from palpate.physics.bodies.indentation_table import SOFTEST, SPACING, hat_moments, patch_radius, rise
from palpate.physics.geometry.mesh import Mesh

PLACES = 100
"""Places of the surface at which the nonlinear organ is pressed."""
RADIUS = 8e-3
"""[m] Of the patch that it is pressed with."""
LEVELS = 10
"""Indentations s/R up to LEVELS SPACING."""
UNSEEN, UNSEEN_SEED = 4, 2
"""Places at which the table is compared with the full model that they were not made from."""
INSIDE = np.array([0.5, 0.3, 0.2])
"""Where in a triangle the organ is pressed: a place like any other; at corners a load is narrower than elsewhere."""


def press(organ: Reducible, patches: np.ndarray, depths: np.ndarray, report: Report = unheard) -> list[PressCurve]:
    """Force curves of the organ of modulus 1 Pa at places (P,) whose surface sticks to the finger.

    patches  (P,V,3)  unit loads at each place, by the vertices of the surface
    depths   [m] (P,L) growing indentations, each the mean displacement along the load, weighted as it is
    """
    model, hats = OrganPress(organ), organ.hats
    done = 0

    def count(levels: int) -> None:
        nonlocal done
        done += levels
        report(done / depths.size)

    places = zip(patches, depths, strict=True)
    return model.run([model.curve(hats @ load, deep, sticking(hats, load), count) for load, deep in places])


def sticking(hats: np.ndarray, load: np.ndarray) -> csr_array:
    """Means of displacement (M,3N) that a finger under this load (V,3) holds: how far the surface slides across the
    load under each vertex that carries some of it, less the mean of that with the load's weights. So the surface keeps
    its shape in the finger's plane, moves along it as one, and has no force along it in all.

    hats  (N,V) see `fe.reduce.reducible`
    """
    resultant = load.sum(axis=0)
    _, _, axes = np.linalg.svd(resultant[None])
    own = np.flatnonzero(np.abs(load).max(axis=1) > 0.0)
    share = load[own] @ resultant / (resultant @ resultant)
    relative = np.delete(np.eye(len(own)) - share, np.argmax(share), axis=0)  # the heaviest follows from the others
    return csr_array(kron(csr_array(relative @ hats[:, own].T), axes[1:], format="csr"))


def patch(surface: Mesh, foot: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Unit force (V,3) on the vertices of a surface: pressure (1 - d²/R²)² round a foot point, against its normal.

    ValueError: no part of the surface within the radius faces the normal.
    """
    corner, face, hat = surface.vertices[surface.triangles], surface.face_vectors, face_rule.HATS
    away = np.linalg.norm(np.einsum("qc,fci->fqi", hat, corner) - foot, axis=2) / radius
    weight = np.where(away < 1.0, (1.0 - away * away) ** 2, 0.0) * face_rule.WEIGHTS
    weight *= (np.linalg.norm(face, axis=1) * (face @ normal > 0.0))[:, None]
    share = np.zeros(len(surface.vertices))
    np.add.at(share, surface.triangles, np.einsum("fq,qc->fc", weight, hat))
    if not share.sum() > 0.0:
        raise ValueError(f"no surface within {radius} m of {foot}")
    return -np.outer(share / share.sum(), normal)


def scattered(points: np.ndarray, count: int, apart: float) -> np.ndarray:
    """Indices of up to `count` points (N,3) at least `apart` [m] from one another: each the one farthest from those
    before, the highest first."""
    chosen = [int(np.argmax(points[:, 2]))]
    away = np.linalg.norm(points - points[chosen[0]], axis=1)
    for _ in range(min(count, len(points)) - 1):
        if away.max() < apart:
            break
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.array(chosen)


def dent_table(
    organ: Reducible, places: int = PLACES, radius: float = RADIUS, report: Report = unheard, levels: int = LEVELS
) -> np.ndarray:
    """Dents (V,L) [1] at every vertex of the organ's surface and every indentation s/R = SPACING, 2 SPACING ..., see
    `physics.bodies.indentation_table`: found for patches at scattered places, a spline through these between."""
    surface = organ.surface
    deep = SPACING * np.arange(1, levels + 1)
    curves, shares, across = _pressed(organ, *pressed_places(surface, places, radius), radius, deep, report)
    # x of `physics.bodies.indentation_table`
    linear = np.array([c.force / (c.stiffness * r) for c, r in zip(curves, across, strict=True)])
    return spread_out(surface.vertices, shares, continued(linear) / deep - 1.0)


def unseen(organ: Reducible, table: np.ndarray) -> np.ndarray:
    """Error [1] (P,L) of the force that a table (V,L) gives at places that they were not made from, at every
    indentation; NaN where the full model finds no equilibrium."""
    surface, levels = organ.surface, table.shape[1]
    feet, normals = pressed_places(surface, len(surface.triangles), 0.25 * RADIUS)
    own = np.random.default_rng(UNSEEN_SEED).choice(len(feet), min(UNSEEN, len(feet)), replace=False)
    deep, every = SPACING * np.arange(1, levels + 1), np.arange(len(surface.vertices))
    curves, shares, across = _pressed(organ, feet[own], normals[own], RADIUS, deep)
    errors = np.full((len(own), levels), np.nan)
    for k, curve in enumerate(curves):
        knots, slopes = np.zeros((2, levels + 1))
        rise(table, every, len(every), shares[k][:, None], knots, slopes)
        errors[k] = knots[1:] * curve.stiffness * across[k] / curve.force - 1.0
    return errors


def _pressed(
    organ: Reducible, feet: np.ndarray, normals: np.ndarray, radius: float, deep: np.ndarray, report: Report = unheard
) -> tuple[list[PressCurve], np.ndarray, np.ndarray]:
    """Curves of patches at these places (P,3), pressed to indentations s/R (L,); shares (P,V) of the vertices in each
    load, and its radius [m] (P,)."""
    surface = organ.surface
    patches = np.stack([patch(surface, foot, n, radius) for foot, n in zip(feet, normals, strict=True)])
    shares = -np.einsum("pvi,pi->pv", patches, normals)
    moments, every = hat_moments(surface), np.arange(len(surface.vertices))
    across = np.array([patch_radius(surface.vertices, moments, every, len(every), m[:, None]) for m in shares])
    return press(organ, patches, across[:, None] * deep, report), shares, across


def pressed_places(surface: Mesh, places: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] (P,3) scattered over the part of a surface that does not look down on the bed, and normals there;
    twice the radius away from its edge where it has one."""
    normals = surface.normals[surface.triangles].transpose(0, 2, 1) @ INSIDE
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    feet = surface.vertices[surface.triangles].transpose(0, 2, 1) @ INSIDE
    seen = normals[:, 2] > -0.5
    edges, count = surface.edges
    if (count == 1).any():
        rim = surface.vertices[np.unique(edges[count == 1])]
        inner = seen & (np.linalg.norm(feet[:, None] - rim[None], axis=2).min(axis=1) > 2.0 * radius)
        seen = inner if inner.any() else seen
    own = np.flatnonzero(seen)
    chosen = own[scattered(feet[own], places, radius)]
    return feet[chosen], normals[chosen]


def continued(rising: np.ndarray) -> np.ndarray:
    """Rows (P,L) of x at s/R = SPACING, 2 SPACING ... whose missing ends go on as the parabola through the last three
    (rest, and the linear organ pulled, come before the first), at least with `SOFTEST` of the linear slope."""
    out = rising.copy()
    for row in out:
        for k in np.flatnonzero(~np.isfinite(row)).tolist():
            a, b, c = np.concatenate([(-2.0 * SPACING, -SPACING, 0.0), row[:k]])[-3:]
            row[k] = c + max(2.0 * (c - b) - (b - a), SOFTEST * SPACING)
    return out


def spread_out(points: np.ndarray, shares: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (N,L) at points (N,3) whose means with weights (P,N) are the given ones (P,L).

    Of all such functions the polyharmonic spline of cubes: a linear function of place and cubes of the distances from
    the weighted points. J. Duchon, in Constructive Theory of Functions of Several Variables (Springer, 1977) 85-100.
    """
    kernel = np.linalg.norm(points[:, None] - points[None], axis=2) ** 3 @ shares.T
    line = np.column_stack([np.ones(len(points)), (points - points.mean(axis=0)) / np.ptp(points)])
    many = len(shares)
    size = float(np.abs(kernel).max())
    system = np.zeros((many + 4, many + 4))
    system[:many, :many] = shares @ kernel / size
    system[:many, many:] = shares @ line
    system[many:, :many] = system[:many, many:].T
    given = np.concatenate([values, np.zeros((4, values.shape[1]))])
    coefficients = np.linalg.lstsq(system, given, rcond=1e-12)[0]  # points in a plane leave one slope open
    return kernel @ coefficients[:many] / size + line @ coefficients[many:]
