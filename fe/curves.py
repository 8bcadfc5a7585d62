"""What the nonlinear organ adds to the linear one under a patch load, place by place.

The load f g grows at a place, g the unit load of a patch of radius R. The full model gives its indentation s(f), the
linear one c f. The dent that the linear model misses is

    d(f) = s(f) - c f = R delta(f/(E R²))

with delta free of units. All places are solved together: the factor at rest preconditions a fixed-point iteration

    u <- u + K0⁻¹ (f g - r(u)),    r(u) inner forces of the nonlinear model and its bed,

sped up by mixing earlier iterates. Elements that strain and turn by less than `LINEAR` keep their tangent at rest.
D. G. Anderson, J. ACM 12 (1965) 547-560; H. F. Walker, P. Ni, SIAM J. Numer. Anal. 49 (2011) 1715-1735.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.fe import faces as face_rule
from palpate.fe.cholesky import Cholesky
from palpate.fe.compiled import LAW, compiled
from palpate.fe.elements import gradients, integrate
from palpate.fe.materials import linear
from palpate.fe.organ import Organ
from palpate.physics.dents import SPACING, hat_moments, patch_radius
from palpate.physics.mesh import Mesh

PLACES = 40
"""Places of the surface at which the nonlinear organ is pressed."""
RADIUS = 8e-3
"""[m] Of the patch that it is pressed with."""
LEVELS = 6
"""Load levels p = f/(E R²) up to LEVELS SPACING."""
STEEPEST = 3.0
"""Greatest power of the level with which dents go on beyond the level that was reached."""
INSIDE = np.array([0.5, 0.3, 0.2])
"""Where in a triangle the organ is pressed: a place like any other; at corners a load is narrower than elsewhere."""
LINEAR = 0.02
"""Greatest entry of the displacement gradient at the largest load below which an element counts as linear."""
TOLERANCE = 2e-4
"""Residual, as the linear indentation that it would cause over the indentation."""
MOST = 25
"""Iterations of a load level; a place that needs more has come to its limit load."""
MEMORY = 10
"""Iterates that are mixed."""
BACKS = 4
"""Times that an iteration of one level may be taken back."""


class _Place:
    """The nonlinear elements under one patch, and the iterates of its load level."""

    def __init__(self, organ: Organ, slope: np.ndarray, weight: np.ndarray, load: np.ndarray, unit: np.ndarray) -> None:
        elements = organ.mesh.elements
        self.load, self.unit = load, unit
        self.compliance = float(np.sum(load * unit))
        self._steep = np.abs(np.einsum("eai,eqaj->eqij", unit[elements], slope)).max(axis=(1, 2, 3))
        self._organ, self._slope, self._weight = organ, slope, weight
        self.force, self.u = 0.0, np.zeros_like(unit)
        self.slope = unit
        self.lost = False

    def choose(self, force: float) -> None:
        """Take the elements that this force strains or turns beyond `LINEAR`."""
        organ = self._organ
        self._groups = []
        for region, material in organ.materials(1.0).items():
            ratio = organ.nodule.ratio if region == 1 else 1.0
            own = np.flatnonzero((organ.mesh.region == region) & (force * self._steep > LINEAR))
            if len(own):
                rest = linear(ratio, organ.poisson)
                self._groups.append((material, rest, organ.mesh.elements[own], self._slope[own], self._weight[own]))

    def begin(self, force: float) -> None:
        """Start a load level, going on as the last one went."""
        self.choose(force)
        self.start = self.u
        self.goal = force
        self.u = self.u + (force - self.force) * self.slope
        self._steps: list[np.ndarray] = []
        self._points: list[np.ndarray] = []
        self._backed = 0

    def beyond(self, u: np.ndarray) -> np.ndarray | None:
        """Inner forces less those of the organ at rest's stiffness (N,3); None where an element turns inside out."""
        force = np.zeros_like(u)
        nothing, blocks = np.zeros((0, 10, 10), dtype=np.int64), np.zeros((0, 3, 3))
        for material, rest, elements, slope, weight in self._groups:
            for sign, law in ((1.0, material), (-1.0, rest)):
                part = np.zeros_like(u)
                _, bad = integrate(
                    compiled(law.law, LAW), slope, weight, elements, u, np.array(law.parameters), law.mixed, law.small,
                    False, nothing, part, blocks,
                )  # fmt: skip
                if bad >= 0:
                    return None
                force += sign * part
        return force

    def end(self) -> float:
        """Keep what was found at this level; the dent [m] there."""
        self.slope = (self.u - self.start) / (self.goal - self.force)
        self.force = self.goal
        return float(np.sum(self.load * self.u)) - self.compliance * self.force

    def residual(self, rest: Any) -> np.ndarray | None:
        """Unbalanced force (N,3); None where elements turn inside out even halfway back to the last level."""
        extra = self.beyond(self.u)
        while extra is None:
            if self._backed == BACKS:
                return None
            self._backed += 1
            self._steps, self._points = [], []
            self.u = 0.5 * (self.u + self.start)
            extra = self.beyond(self.u)
        found: np.ndarray = self.goal * self.load - (rest @ self.u.ravel()).reshape(-1, 3) - extra
        return found

    def settled(self, step: np.ndarray) -> bool:
        """Whether a step of the iteration is small: in the indentation, and overall."""
        miss = abs(float(np.sum(self.load * step))) / (self.compliance * self.goal)
        size = float(np.linalg.norm(step)) / float(np.linalg.norm(self.u))
        return max(miss, 0.3 * size) < TOLERANCE

    def mix(self, step: np.ndarray) -> None:
        """Next iterate from the step K0⁻¹ times the residual here, and those before."""
        self._steps.append(step)
        self._points.append(self.u)
        del self._steps[: -MEMORY - 1], self._points[: -MEMORY - 1]
        self.u = self.u + step
        if len(self._steps) > 1:
            steps, points = np.diff(self._steps, axis=0), np.diff(self._points, axis=0)
            many = len(steps)
            share = np.linalg.lstsq(steps.reshape(many, -1).T, step.ravel(), rcond=1e-10)[0]
            self.u = self.u - np.tensordot(share, steps + points, axes=1)


def dents(
    organ: Organ,
    patches: np.ndarray,
    levels: np.ndarray,
    report: Callable[[float], None] | None = None,
) -> np.ndarray:
    """Indentation (P,L) [m] of the nonlinear organ of modulus 1 Pa less that of the linear one, under growing loads.

    patches  (P,V,3)  unit loads at each place, by the vertices of the surface
    levels   [N] (P,L) growing forces on them
    report   hears the share done

    NaN from the level on at which a place gives way.
    """
    mesh = organ.mesh
    stiffness = organ.stiffness()
    solver = Cholesky(mesh.points, organ.pattern.indptr, organ.pattern.indices)
    solver.factor(stiffness)
    rest = organ.pattern.matrix(stiffness)
    hats = organ.hats()
    slope, det = gradients(mesh.points, mesh.elements)
    loads = np.einsum("nv,pvi->npi", hats, patches)

    def solve(many: np.ndarray) -> np.ndarray:
        found: np.ndarray = solver.solve(many.transpose(0, 2, 1).reshape(3 * len(many), -1))
        return found.reshape(len(many), 3, -1).transpose(2, 0, 1)

    units = solve(loads)
    places = [_Place(organ, slope, det / 24.0, loads[:, p], units[p]) for p in range(len(patches))]
    found = np.full(levels.shape, np.nan)
    for k in range(levels.shape[1]):
        open_ = [p for p, place in enumerate(places) if not place.lost]
        for p in open_:
            places[p].begin(levels[p, k])
        for _ in range(MOST):
            rests = [places[p].residual(rest) for p in open_]
            for p, step in zip(open_, rests, strict=True):
                places[p].lost = step is None
            open_ = [p for p in open_ if not places[p].lost]
            if not open_:
                break
            steps = solve(np.stack([x for x in rests if x is not None], axis=1))
            left = []
            for p, step in zip(open_, steps, strict=True):
                if places[p].settled(step):
                    found[p, k] = places[p].end()
                else:
                    places[p].mix(step)
                    left.append(p)
            open_ = left
            if report is not None:
                report((k + 1 - len(open_) / len(places)) / levels.shape[1])
        for p in open_:
            places[p].lost = True
    return found


def patch(surface: Mesh, foot: np.ndarray, normal: np.ndarray, radius: float) -> np.ndarray:
    """Unit force (V,3) on the vertices of a surface: pressure (1 - d²/R²)² round a foot point, against its normal.

    ValueError: no part of the surface within the radius faces the normal.
    """
    corner = surface.vertices[surface.triangles]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    x, y = face_rule.POINTS.T
    hat = np.stack([1.0 - x - y, x, y], axis=1)
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
    organ: Organ,
    places: int = PLACES,
    radius: float = RADIUS,
    report: Callable[[float], None] | None = None,
    levels: int = LEVELS,
) -> np.ndarray:
    """Dents (V,L) [1] at every vertex of the organ's surface and every level p = SPACING, 2 SPACING ..., see
    `physics.dents`: found for patches at scattered places, a biharmonic spline through these between."""
    surface = organ.surface
    feet, normals = pressed_places(surface, places, radius)
    patches = np.stack([patch(surface, foot, n, radius) for foot, n in zip(feet, normals, strict=True)])
    shares = -np.einsum("pvi,pi->pv", patches, normals)
    moments, every = hat_moments(surface), np.arange(len(surface.vertices))
    across = np.array([patch_radius(surface.vertices, moments, every, len(every), m[:, None]) for m in shares])
    loads = 0.5 * SPACING * np.arange(1, 2 * levels + 1)  # half steps, so that the iteration starts close
    found = dents(organ, patches, across[:, None] ** 2 * loads, report) / across[:, None]
    return spread_out(surface.vertices, shares, continued(loads, found)[:, 1::2])


def pressed_places(surface: Mesh, places: int, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] (P,3) scattered over the part of a surface that does not look down on the bed, and normals there;
    twice the radius away from its edge where it has one."""
    normals = surface.normals[surface.triangles].transpose(0, 2, 1) @ INSIDE
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    feet = surface.vertices[surface.triangles].transpose(0, 2, 1) @ INSIDE
    seen = normals[:, 2] > -0.5
    edges, count = np.unique(
        np.sort(surface.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    if (count == 1).any():
        rim = surface.vertices[np.unique(edges[count == 1])]
        inner = seen & (np.linalg.norm(feet[:, None] - rim[None], axis=2).min(axis=1) > 2.0 * radius)
        seen = inner if inner.any() else seen
    own = np.flatnonzero(seen)
    chosen = own[scattered(feet[own], places, radius)]
    return feet[chosen], normals[chosen]


def continued(levels: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Rows (P,L) at levels (L,) whose missing ends go on as the power of the level that the last two follow, held
    between 1 and `STEEPEST`; straight on where these have no power, from 0 where there is but one."""
    out = found.copy()
    for row in out:
        lost = np.flatnonzero(~np.isfinite(row))
        if len(lost) == 0:
            continue
        k = int(lost[0])
        last, before = (row[k - 1] if k > 0 else 0.0), (row[k - 2] if k > 1 else 0.0)
        at = levels[k - 1] if k > 0 else levels[0]
        if before > 0.0 and last > before:
            power = np.log(last / before) / np.log(at / levels[k - 2])
            row[k:] = last * (levels[k:] / at) ** min(max(power, 1.0), STEEPEST)
        else:
            slope = (last - before) / (at - levels[k - 2]) if k > 1 else last / at
            row[k:] = last + slope * (levels[k:] - at)
    return out


def spread_out(points: np.ndarray, shares: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values (N,L) at points (N,3) whose means with weights (P,N) are the given ones (P,L).

    Of all such functions the biharmonic spline: a constant and distances from the weighted points.
    """
    kernel = -np.linalg.norm(points[:, None] - points[None], axis=2) @ shares.T
    many = len(shares)
    system = np.ones((many + 1, many + 1))
    system[:many, :many], system[many, many] = shares @ kernel, 0.0
    found = np.linalg.solve(system, np.concatenate([values, np.zeros((1, values.shape[1]))]))
    out: np.ndarray = kernel @ found[:many] + found[many]
    return out
