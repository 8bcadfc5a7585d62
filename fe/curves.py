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

import numpy as np

from palpate.fe.bed import Bed
from palpate.fe.cholesky import Cholesky
from palpate.fe.compiled import LAW, compiled
from palpate.fe.elements import gradients, integrate
from palpate.fe.materials import linear
from palpate.fe.organ import Organ

LINEAR = 0.01
"""Greatest entry of the displacement gradient at the largest load below which an element counts as linear."""
TOLERANCE = 2e-4
"""Residual, as the linear indentation that it would cause over the indentation."""
MOST = 40
"""Iterations of a load level; a place that needs more has come to its limit load."""
MEMORY = 6


class _Place:
    """The nonlinear elements under one patch, and the iterates of its load level."""

    def __init__(self, organ: Organ, slope: np.ndarray, weight: np.ndarray, load: np.ndarray, unit: np.ndarray) -> None:
        elements = organ.mesh.elements
        self.load, self.unit = load, unit
        self.compliance = float(np.sum(load * unit))
        self._steep = np.abs(np.einsum("eai,eqaj->eqij", unit[elements], slope)).max(axis=(1, 2, 3))
        self._organ, self._slope, self._weight = organ, slope, weight
        self.u = np.zeros_like(unit)
        self.done: list[float] = []
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

    def begin(self, force: float, before: float) -> None:
        """Start a load level from the last one's end, in proportion."""
        self.choose(force)
        self.u = self.unit * force if not self.done else self.u + (force - before) * self.unit
        self._steps: list[np.ndarray] = []
        self._points: list[np.ndarray] = []

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
    levels   [N] (L,) growing forces on them
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
    found = np.full((len(places), len(levels)), np.nan)
    before = 0.0
    for k, force in enumerate(levels):
        open_ = [p for p in range(len(places)) if not places[p].lost]
        for p in open_:
            places[p].begin(force, before)
        for _ in range(MOST):
            steps, left = [], []
            for p in open_:
                place = places[p]
                extra = place.beyond(place.u)
                if extra is None:
                    place.lost = True
                    continue
                steps.append(force * place.load - (rest @ place.u.ravel()).reshape(-1, 3) - extra)
                left.append(p)
            if not left:
                break
            open_ = []
            for p, step in zip(left, solve(np.stack(steps, axis=1)), strict=True):
                place = places[p]
                miss = abs(float(np.sum(place.load * step)))
                size = float(np.linalg.norm(step)) / float(np.linalg.norm(place.u))
                if max(miss / (place.compliance * force), 0.3 * size) < TOLERANCE:
                    place.done.append(force)
                    found[p, k] = float(np.sum(place.load * place.u)) - place.compliance * force
                else:
                    place.mix(step)
                    open_.append(p)
        for p in open_:
            places[p].lost = True
        before = force
        if report is not None:
            report((k + 1) / len(levels))
    return found
