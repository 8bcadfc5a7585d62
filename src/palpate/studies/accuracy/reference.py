"""Reference solutions of the test cases over time.

Closed forms:

    ball on a half-space       f = 4/3 E/(1-nu²) sqrt(R) e^1.5            K. L. Johnson, Contact Mechanics (1985), ch. 4
    fingertip on a plate       f = (b/m)(exp(m e) - 1) <1 + c e'>          docs/equations/contact.md

On the slab the stored static curve s = S(h) of the site (`sites`) is solved in series with the fingertip; the slab is a
Kelvin-Voigt solid with the elastic force h:

    e = s1 + s,   f = g(s1) <1 + c s1'>,   s = S(h),   tau h' + h = f

by implicit Euler at `RATE` and half of it; the solution is 2 fine - coarse, and the uncertainty band includes their
difference. Friction is the law of friction.LuGre with the reference normal force, by its differential equation. None of
this shares code with the nodes. On the kidney the curve changes along the path: S(h, x) is the parabola in x through
the curves of three stored sites, and the band includes the difference to linear interpolation. Two organs follow the
stored curve of their meeting (`studies.meeting.stored`).
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from palpate.compiler.kernel import kernel
from palpate.nodes.contact import Series
from palpate.physics.friction.lugre import LuGre
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.sites import SITES, ReferenceSite, load_reference, on_path
from palpate.studies.meeting.stored import meeting_values
from palpate.studies.peers.continuum import POISSON, RADIUS, YOUNG

RATE = 32000  # [Hz]
QUANTITIES = {
    "force": "N", "friction": "N", "indentation": "m", "shape": "m", "area": "m²", "traction": "Pa", "energy": "J",
}  # fmt: skip
"""Compared quantities with their units."""
EXACT = 1e-9
"""[1] Uncertainty of a closed form: rounding, and a compliance of 1e-12 m/N of the rigid parts."""
HERTZ = 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * math.sqrt(RADIUS)  # [N/m^1.5] Of the ball on the half-space
SLIDING = LuGre(0.5, 0.7, 0.02, bristle_stiffness=500.0, bristle_damping=1.0, viscous=0.4, rescale=False)
"""Friction of the kidney scene, by the unmodified differential equation."""


@dataclass(frozen=True)
class ReferenceSolution:
    """Values and uncertainty bands over time [s] (T,), by quantity (T,).

    elastic  [N] (T,) elastic force, which determines the shape of the surface
    """

    times: np.ndarray
    values: dict[str, np.ndarray]
    bands: dict[str, np.ndarray]
    elastic: np.ndarray
    touch: BenchCase
    place: ReferenceSite | None

    def value(self, name: str, times: np.ndarray) -> np.ndarray:
        return np.interp(times, self.times, self.values[name])

    def band(self, name: str, times: np.ndarray) -> np.ndarray:
        return np.interp(times, self.times, self.bands[name])

    def depth(self, points: np.ndarray, time: float) -> np.ndarray:
        """Depth of the surface [m] (k,) at points [m] (k,2)."""
        h = float(np.interp(time, self.times, self.elastic))
        _, _, x, _ = self.touch.at(np.array([time]))
        if self.touch.body == "half-space":
            deep = float(np.interp(time, self.times, self.values["indentation"]))
            return _hertz_shape(np.hypot(points[:, 0] - x[0], points[:, 1]), deep)
        assert self.place is not None
        there = points - (x[0] - self.place.about["place"]["place"], 0.0)
        return _surface_shape(self.touch.place)(there, h)

    def shape_band(self, time: float) -> float:
        """RMS uncertainty [m] of the shape."""
        if self.place is None:
            return 0.0
        h = float(np.interp(time, self.times, self.elastic))
        return float(np.interp(h, np.append(0.0, self.place.force), np.append(0.0, self.place.shape_band)))


@lru_cache(maxsize=16)
def reference_solution(touch: BenchCase) -> ReferenceSolution:
    """The reference solution of a test case. MissingError: its reference is not stored."""
    # Closed forms: ball on a half-space, fingertip on a plate.
    times = np.arange(round(touch.duration * RATE) + 1) / RATE
    approach, rate, _, slip = touch.at(times)
    near = np.maximum(approach, 0.0)
    if touch.body == "half-space":
        force = HERTZ * near**1.5
        area = math.pi * RADIUS * near
        traction = np.divide(1.5 * force, area, out=np.zeros_like(force), where=area > 0.0)
        values = {"force": force, "indentation": near, "area": area, "traction": traction, "energy": 0.4 * force * near}
        return ReferenceSolution(times, values, {k: EXACT * np.abs(v) for k, v in values.items()}, force, touch, None)
    if touch.body == "organs":
        values, bands = meeting_values(touch.meeting, near)
        return ReferenceSolution(times, values, bands, values["force"], touch, None)
    finger = Series()
    b, m, c = finger.finger_stiffness, finger.finger_hardening, finger.finger_damping
    if touch.body == "plate":
        force = b / m * np.expm1(m * near) * np.maximum(1.0 + c * rate, 0.0)
        values = {"force": force}
        return ReferenceSolution(times, values, {"force": EXACT * force}, force, touch, None)
    # Slab and kidney: extrapolate the time step, and add up the uncertainties of curve, path interpolation and step.
    places, at = [load_reference(name) for name in on_path(touch.place)], path_of(touch)
    levels = places[0].force
    depth, band = (np.array([getattr(p, name) for p in places]) for name in ("indentation", "band"))
    fine, coarse = (in_time(touch, levels, depth, every, at) for every in (1, 2))
    off = in_time(touch, levels, depth + band, at=at)
    bent = in_time(touch, levels, depth, at=at, smooth=False)
    refined = [2.0 * a - np.interp(times, times[::2], b) for a, b in zip(fine, coarse, strict=True)]
    refined = [np.maximum(one, 0.0) for one in refined]
    steps = [np.abs(a - np.interp(times, times[::2], b)) for a, b in zip(fine, coarse, strict=True)]
    spread = [np.abs(a - b) + np.abs(c - b) + d for a, b, c, d in zip(off, fine, bent, steps, strict=True)]
    values = derive_quantities(touch, slip, *refined[:2])
    above = derive_quantities(touch, slip, *(a + d for a, d in zip(refined[:2], spread[:2], strict=True)))
    bands = {name: np.abs(above[name] - value) for name, value in values.items()}
    return ReferenceSolution(times, values, bands, refined[2], touch, places[0] if touch.body == "slab" else None)


def path_of(touch: BenchCase) -> np.ndarray:
    """Positions [m] (K,) of the reference sites along the path."""
    return np.array([SITES[name].place for name in on_path(touch.place)])


def derive_quantities(
    touch: BenchCase, slip: np.ndarray, force: np.ndarray, depth: np.ndarray
) -> dict[str, np.ndarray]:
    """Compared quantities from force [N] and indentation [m] (T,); area and traction on the flat slab only."""
    patch = math.pi * RADIUS**2
    values = {"force": force, "indentation": depth, "energy": compute_work(force, depth)}
    if touch.body == "slab":
        values |= {"area": np.where(force > 0.0, patch, 0.0), "traction": 3.0 * force / patch}
    if touch.friction:
        values["friction"] = _lugre(force, slip, 1.0 / RATE, *SLIDING[:6])
    return values


def compute_work(force: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Work [J] (T,) done on a body by forces [N] along its indentation [m]."""
    return np.append(0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(depth)))


def in_time(
    touch: BenchCase,
    levels: np.ndarray,
    indentation: np.ndarray,
    every: int = 1,
    at: np.ndarray | None = None,
    smooth: bool = True,
) -> list[np.ndarray]:
    """Force [N], indentation [m] and elastic force [N] at every `every`-th instant.

    levels, indentation  [N] (L,), [m] (L,) of the static curve, or (K,L) at the positions `at` [m] (K,) of the path
    smooth               polynomial interpolation along the path; otherwise linear
    """
    times = np.arange(0, round(touch.duration * RATE) + 1, every) / RATE
    approach, _, place, _ = touch.at(times)
    finger = Series()
    curves = np.atleast_2d(indentation)
    spline = CubicSpline(np.append(0.0, levels), np.pad(curves, ((0, 0), (1, 0))), axis=1)
    solved = _kelvin_voigt(
        approach, every / RATE, touch.retardation, finger.finger_stiffness, finger.finger_hardening,
        finger.finger_damping, np.ascontiguousarray(spline.x), np.ascontiguousarray(np.moveaxis(spline.c, 2, 0)),
        _shares(place, np.zeros(1) if at is None else at, smooth),
    )  # fmt: skip
    return list(solved)


def _shares(place: np.ndarray, at: np.ndarray, smooth: bool) -> np.ndarray:
    """Weights (T,K) of the curves of the sites `at` [m] (K,) at these positions [m] (T,)."""
    if not smooth:
        return np.stack([np.interp(place, at, one) for one in np.eye(len(at))], axis=1)
    others = [np.delete(at, k) for k in range(len(at))]
    return np.stack([np.prod((place[:, None] - o) / (a - o), axis=1) for a, o in zip(at, others, strict=True)], axis=1)


@kernel
def _at(x, c, h):
    """A cubic spline, continued linearly after its last point."""
    k = min(max(np.searchsorted(x, h) - 1, 0), len(x) - 2)
    d = min(h, x[-1]) - x[k]
    value = ((c[0, k] * d + c[1, k]) * d + c[2, k]) * d + c[3, k]
    if h > x[-1]:
        value += (h - x[-1]) * ((3.0 * c[0, k] * d + 2.0 * c[1, k]) * d + c[2, k])
    return value


@kernel
def _kelvin_voigt(approach, dt, tau, b, m, c, x, of_sites, shares):
    """Fingertip in series with a Kelvin-Voigt slab, by implicit Euler: force [N], indentation [m], elastic force [N].

    approach [m] (T,);  dt, tau [s];  b [N/m], m [1/m], c [s/m] of the fingertip;  x [N] (L+1,) knots and
    of_sites (K,4,L) coefficients of the static curves;  shares (T,K) their weights
    """
    force, depth, elastic = np.zeros(len(approach)), np.zeros(len(approach)), np.zeros(len(approach))
    h = s1 = 0.0
    for i in range(len(approach)):
        # Static curve at this position, and the implicit step of the slab: h' = keep h + take f.
        coefficients = shares[i, 0] * of_sites[0]
        for k in range(1, len(of_sites)):
            coefficients += shares[i, k] * of_sites[k]
        keep, take = tau / (tau + dt), dt / (tau + dt)
        s = _at(x, coefficients, keep * h)
        rest = max(s1 - dt / c, 0.0) if c > 0.0 else 0.0
        f = 0.0
        # In contact: bisect the force at which fingertip and slab agree.
        if approach[i] - s > rest:
            low, high = 0.0, 1.0
            while _finger(approach[i] - _at(x, coefficients, keep * h + take * high), s1, dt, b, m, c) > high:
                high *= 2.0
            for _ in range(60):
                f = 0.5 * (low + high)
                if _finger(approach[i] - _at(x, coefficients, keep * h + take * f), s1, dt, b, m, c) > f:
                    low = f
                else:
                    high = f
        h = keep * h + take * f
        s = _at(x, coefficients, h)
        s1 = approach[i] - s if f > 0.0 else rest
        force[i], depth[i], elastic[i] = f, s, h
    return force, depth, elastic


@kernel
def _finger(s, before, dt, b, m, c):
    """Force [N] of the fingertip at compression s [m]: b/m (exp(m s) - 1) <1 + c s'>."""
    if s <= 0.0:
        return 0.0
    return b / m * math.expm1(m * s) * max(1.0 + c * (s - before) / dt, 0.0)


@kernel
def _lugre(force, slip, dt, mu_slide, mu_static, stribeck, stiffness, damping, viscous):
    """Friction force [N] (T,) along a line, by the exact solution of the bristle at constant speed in each step."""
    friction = np.zeros(len(force))
    z = 0.0
    for i in range(len(force)):
        if force[i] <= 0.0:
            z = 0.0
            continue
        v = slip[i]
        g = mu_slide + (mu_static - mu_slide) * math.exp(-((v / stribeck) ** 2))
        a = stiffness * abs(v) / g
        z = z * math.exp(-a * dt) + (v / a * -math.expm1(-a * dt) if a * dt > 1e-12 else v * dt)
        friction[i] = abs(force[i] * (stiffness * z + damping * (v - a * z) + viscous * v))
    return friction


class SurfaceShape:
    """Surface of a slab as a function of position and force, interpolated between shapes at some forces."""

    def __init__(self, levels: np.ndarray, x: np.ndarray, y: np.ndarray, shapes: np.ndarray) -> None:
        self._levels = np.append(0.0, levels)
        self._splines = [RectBivariateSpline(x, y, s) for s in shapes]

    def __call__(self, points: np.ndarray, force: float) -> np.ndarray:
        """Depth [m] at points (k,2) under a force [N], symmetric about y = 0; cubic through four levels."""
        levels = self._levels
        k = min(max(int(np.searchsorted(levels, force)) - 1, 1), len(levels) - 3)
        near = range(k - 1, k + 3)
        shape = np.zeros(len(points))
        for i in near:
            if i > 0:  # at rest the surface is flat
                share = math.prod((force - levels[j]) / (levels[i] - levels[j]) for j in near if j != i)
                shape += share * self._splines[i - 1].ev(points[:, 0], np.abs(points[:, 1]))
        return shape


@lru_cache(maxsize=16)
def _surface_shape(name: str) -> SurfaceShape:
    site = load_reference(name)
    return SurfaceShape(site.force, site.x, site.y, site.shape)


def _hertz_shape(r: np.ndarray, depth: float) -> np.ndarray:
    """Depth [m] of a half-space at distances r [m] from the axis of a ball at this depth [m] (Johnson, eq. 3.42)."""
    if not depth > 0.0:
        return np.zeros_like(r)
    a = math.sqrt(RADIUS * depth)
    q = np.maximum(r, a)
    outside = ((2 * a * a - q * q) * np.arcsin(a / q) + a * np.sqrt(q * q - a * a)) / (math.pi * RADIUS)
    return np.where(r < a, depth - r * r / (2 * RADIUS), outside)
