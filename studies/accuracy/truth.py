"""What is held for true of a touch, over time.

A closed form where there is one:

    ball on a half-space       f = 4/3 E/(1-nu²) sqrt(R) e^1.5            K. L. Johnson, Contact Mechanics (1985), ch. 4
    fingertip on a plate       f = (b/m)(exp(m e) - 1) <1 + c e'>          docs/equations/contact.md

On the slab the stored static curve s = S(h) of its place (`places`) is solved in series with the fingertip, the
slab a Kelvin-Voigt solid whose elastic force is h:

    e = s1 + s,   f = g(s1) <1 + c s1'>,   s = S(h),   tau h' + h = f

by implicit Euler at `RATE` and at half of it; 2 fine - coarse is kept, their difference is part of the band. Friction
is the law of friction.LuGre over the true normal force, its rate taken from the differential equation. None of this
shares code with the nodes. On the kidney the curve changes along the path: S(h, x) is the parabola in x through those
of three stored places, and what a polygon through them differs by is part of the band.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline, RectBivariateSpline

from palpate.nodes.contact import Series
from palpate.physics.friction.lugre import LuGre
from palpate.physics.kernel import kernel
from palpate.studies.accuracy.places import PLACES, ReferenceSite, on_path, stored
from palpate.studies.accuracy.touches import BenchCase
from palpate.studies.peers.continuum import POISSON, RADIUS, YOUNG

RATE = 32000  # [Hz]
QUANTITIES = {
    "force": "N", "friction": "N", "indentation": "m", "shape": "m", "area": "m²", "traction": "Pa", "energy": "J",
}  # fmt: skip
"""What is compared, with its unit."""
EXACT = 1e-9
"""[1] What a closed form may be off by: rounding, and parts of the set-up that are rigid but for 1e-12 m/N."""
HERTZ = 4.0 / 3.0 * YOUNG / (1.0 - POISSON**2) * math.sqrt(RADIUS)  # [N/m^1.5] Of the ball on the half-space
SLIDING = LuGre(0.5, 0.7, 0.02, bristle_stiffness=500.0, bristle_damping=1.0, viscous=0.4, rescale=False)
"""Friction of the kidney scene, by the plain differential equation."""


@dataclass(frozen=True)
class Truth:
    """Over time [s] (T,): what is known, by quantity (T,); the bands are what it may be off by.

    elastic  [N] (T,) force that the shape of the surface belongs to
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
        """How deep the surface is [m] at points (k,2) of it [m]."""
        h = float(np.interp(time, self.times, self.elastic))
        _, _, x, _ = self.touch.at(np.array([time]))
        if self.touch.body == "half-space":
            deep = float(np.interp(time, self.times, self.values["indentation"]))
            return _hertz_shape(np.hypot(points[:, 0] - x[0], points[:, 1]), deep)
        assert self.place is not None
        there = points - (x[0] - self.place.about["place"]["place"], 0.0)
        return _dent(self.touch.place)(there, h)

    def shape_band(self, time: float) -> float:
        """[m] rms that the shape may be off by."""
        if self.place is None:
            return 0.0
        h = float(np.interp(time, self.times, self.elastic))
        return float(np.interp(h, np.append(0.0, self.place.force), np.append(0.0, self.place.shape_band)))


@lru_cache(maxsize=16)
def truth(touch: BenchCase) -> Truth:
    """The truth of a touch. MissingError: its reference is not stored."""
    times = np.arange(round(touch.duration * RATE) + 1) / RATE
    approach, rate, _, slip = touch.at(times)
    near = np.maximum(approach, 0.0)
    if touch.body == "half-space":
        force = HERTZ * near**1.5
        area = math.pi * RADIUS * near
        traction = np.divide(1.5 * force, area, out=np.zeros_like(force), where=area > 0.0)
        values = {"force": force, "indentation": near, "area": area, "traction": traction, "energy": 0.4 * force * near}
        return Truth(times, values, {k: EXACT * np.abs(v) for k, v in values.items()}, force, touch, None)
    finger = Series()
    b, m, c = finger.finger_stiffness, finger.finger_hardening, finger.finger_damping
    if touch.body == "plate":
        force = b / m * np.expm1(m * near) * np.maximum(1.0 + c * rate, 0.0)
        values = {"force": force}
        return Truth(times, values, {"force": EXACT * force}, force, touch, None)
    places, at = [stored(name) for name in on_path(touch.place)], path_of(touch)
    levels = places[0].force
    depth, band = (np.array([getattr(p, name) for p in places]) for name in ("indentation", "band"))
    fine, coarse = (in_time(touch, levels, depth, every, at) for every in (1, 2))
    off = in_time(touch, levels, depth + band, at=at)
    bent = in_time(touch, levels, depth, at=at, smooth=False)
    refined = [2.0 * a - np.interp(times, times[::2], b) for a, b in zip(fine, coarse, strict=True)]
    refined = [np.maximum(one, 0.0) for one in refined]
    steps = [np.abs(a - np.interp(times, times[::2], b)) for a, b in zip(fine, coarse, strict=True)]
    spread = [np.abs(a - b) + np.abs(c - b) + d for a, b, c, d in zip(off, fine, bent, steps, strict=True)]
    values = derived(touch, slip, *refined[:2])
    above = derived(touch, slip, *(a + d for a, d in zip(refined[:2], spread[:2], strict=True)))
    bands = {name: np.abs(above[name] - value) for name, value in values.items()}
    return Truth(times, values, bands, refined[2], touch, places[0] if touch.body == "slab" else None)


def path_of(touch: BenchCase) -> np.ndarray:
    """Places [m] (K,) of a touch's references along its path."""
    return np.array([PLACES[name].place for name in on_path(touch.place)])


def derived(touch: BenchCase, slip: np.ndarray, force: np.ndarray, depth: np.ndarray) -> dict[str, np.ndarray]:
    """What is compared, from force [N] and indentation [m] (T,) of a body under the patch; area and traction on what is
    flat."""
    patch = math.pi * RADIUS**2
    values = {"force": force, "indentation": depth, "energy": worked(force, depth)}
    if touch.body == "slab":
        values |= {"area": np.where(force > 0.0, patch, 0.0), "traction": 3.0 * force / patch}
    if touch.friction:
        values["friction"] = _lugre(force, slip, 1.0 / RATE, *SLIDING[:6])
    return values


def worked(force: np.ndarray, depth: np.ndarray) -> np.ndarray:
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
    """Force [N], indentation [m] and elastic force [N] at each `every`-th instant, of a body whose static curve goes
    through these forces [N] and indentations [m] (L,) or, at the places `at` [m] (K,) of its path, (K,L). Between them
    it is a polynomial in the place, or a polygon where it is not to be smooth."""
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
    """What the curve of each place `at` [m] (K,) counts (T,K) at these places [m] (T,)."""
    if not smooth:
        return np.stack([np.interp(place, at, one) for one in np.eye(len(at))], axis=1)
    others = [np.delete(at, k) for k in range(len(at))]
    return np.stack([np.prod((place[:, None] - o) / (a - o), axis=1) for a, o in zip(at, others, strict=True)], axis=1)


@kernel
def _at(x, c, h):
    """A cubic spline, straight on beyond its last point."""
    k = min(max(np.searchsorted(x, h) - 1, 0), len(x) - 2)
    d = min(h, x[-1]) - x[k]
    value = ((c[0, k] * d + c[1, k]) * d + c[2, k]) * d + c[3, k]
    if h > x[-1]:
        value += (h - x[-1]) * ((3.0 * c[0, k] * d + 2.0 * c[1, k]) * d + c[2, k])
    return value


@kernel
def _kelvin_voigt(approach, dt, tau, b, m, c, x, of_places, shares):
    force, depth, elastic = np.zeros(len(approach)), np.zeros(len(approach)), np.zeros(len(approach))
    h = s1 = 0.0
    for i in range(len(approach)):
        coefficients = shares[i, 0] * of_places[0]
        for k in range(1, len(of_places)):
            coefficients += shares[i, k] * of_places[k]
        keep, take = tau / (tau + dt), dt / (tau + dt)
        s = _at(x, coefficients, keep * h)
        rest = max(s1 - dt / c, 0.0) if c > 0.0 else 0.0
        f = 0.0
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
    if s <= 0.0:
        return 0.0
    return b / m * math.expm1(m * s) * max(1.0 + c * (s - before) / dt, 0.0)


@kernel
def _lugre(force, slip, dt, mu_slide, mu_static, stribeck, stiffness, damping, viscous):
    """Size of the friction force [N] of a finger that slides along a line; bristles grow exactly at constant speed."""
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


class Dent:
    """The surface of a slab over place and force, from its shapes at some forces."""

    def __init__(self, levels: np.ndarray, x: np.ndarray, y: np.ndarray, shapes: np.ndarray) -> None:
        self._levels = np.append(0.0, levels)
        self._splines = [RectBivariateSpline(x, y, s) for s in shapes]

    def __call__(self, points: np.ndarray, force: float) -> np.ndarray:
        """Depth [m] at points (k,2) under a force [N]; symmetric about y = 0. Cubic through four levels."""
        levels = self._levels
        k = min(max(int(np.searchsorted(levels, force)) - 1, 1), len(levels) - 3)
        own = range(k - 1, k + 3)
        shape = np.zeros(len(points))
        for i in own:
            if i > 0:  # at rest the surface is flat
                share = math.prod((force - levels[j]) / (levels[i] - levels[j]) for j in own if j != i)
                shape += share * self._splines[i - 1].ev(points[:, 0], np.abs(points[:, 1]))
        return shape


@lru_cache(maxsize=16)
def _dent(name: str) -> Dent:
    place = stored(name)
    return Dent(place.force, place.x, place.y, place.shape)


def _hertz_shape(r: np.ndarray, depth: float) -> np.ndarray:
    """Depth [m] of a half-space at distances [m] from a ball that is this deep [m]. Johnson, eq. 3.42."""
    if not depth > 0.0:
        return np.zeros_like(r)
    a = math.sqrt(RADIUS * depth)
    q = np.maximum(r, a)
    outside = ((2 * a * a - q * q) * np.arcsin(a / q) + a * np.sqrt(q * q - a * a)) / (math.pi * RADIUS)
    return np.where(r < a, depth - r * r / (2 * RADIUS), outside)
