"""Stiff balls below a probed surface, by the model of a nodule that ships (`physics.materials.nodule`).

    ln K_i = m + sum_j ln k_j(x_i) + g(x_i) + n_i

k_j is the factor on the stiffness above ball j, averaged over the patch under the probe as MassSpring does (Hertz's
pressure), and g + n the smooth field and the deviations of `field`. Balls are added at the largest residual while the
Bayesian information criterion falls by more than `CLEAR`. Their intervals are central 95 % of the posterior of
balls and field (random-walk Metropolis, N. Metropolis et al., J. Chem. Phys. 21, 1953, 1087), for a position that is
uniform around the probed region, and a radius and a depth that are uniform in their logarithms. The modulus of a ball
over that of the tissue is not determined and is given.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import least_squares, minimize
from scipy.spatial.distance import cdist

from palpate.models.fit.probes.field import Field, fit_field, matern, restricted_likelihood
from palpate.physics.materials.nodule import SHARPER, nodule_centre, stiffness_map

CLEAR = 2.0
"""Difference of the criterion from which there is evidence for a ball. Chosen on the silicone of docs/measured.md: the
usual value, 10, misses its second ball with the power law. A false ball in 1 of 20 simulated maps
(`benchmarks/probes.py`)."""
MOST = 6  # balls
PEAKS = 3  # of the residual, at which another ball is tried
APART = 0.8  # [1] Least distance of the centres of two balls, over the sum of their radii
NUMBERS = 4  # of a ball: u, v, ln of its top's depth, ln of its radius
DRAWS, BURN = 10_000, 3_000
MEAN = 10.0  # Variance of the mean: its prior is uninformative
RING, ON_RING = math.sqrt(4.0 / 7.0), 0.7
"""[1] Radius over that of the patch, and weight, of six points that with its middle integrate polynomials of degree 5
under Hertz's pressure."""


@dataclass(frozen=True)
class Inclusion:
    """A stiff ball: values and 95 % intervals in [m].

    position (3)  point of the surface above its centre;  depth  of its centre;  across  half-widths of the interval of
    the position along two axes of the surface
    """

    position: np.ndarray
    across: tuple[float, float]
    depth: tuple[float, float, float]
    radius: tuple[float, float, float]
    factor: float


@dataclass(frozen=True)
class Ground:
    """The probed surface and the patch under a probe.

    places, normals (N,3);  axes (2,3) of the mean plane;  middle (3);  reach [m] radius of the patch
    """

    places: np.ndarray
    normals: np.ndarray
    axes: np.ndarray
    middle: np.ndarray
    reach: float

    @staticmethod
    def of(places: np.ndarray, normals: np.ndarray | None, reach: float) -> Ground:
        middle = places.mean(axis=0)
        axes = np.linalg.svd(places - middle, full_matrices=False)[2]
        up = axes[2]
        if normals is None:
            normals = np.tile(up if up[2] >= 0.0 else -up, (len(places), 1))
        if float(normals.mean(axis=0) @ np.cross(axes[0], axes[1])) < 0.0:
            axes = np.array([axes[0], -axes[1], axes[2]])
        return Ground(places, normals, axes[:2], middle, reach)

    @property
    def plane(self) -> np.ndarray:
        """Coordinates (N,2) [m] of the places along the two axes."""
        return (self.places - self.middle) @ self.axes.T

    def surface_point(self, uv: np.ndarray) -> np.ndarray:
        """The point (3) [m] of the surface at coordinates (2) of the mean plane, from the three nearest places."""
        apart = np.sum((self.plane - uv) ** 2, axis=1)
        near = np.argsort(apart)[:3]
        weight = 1.0 / (apart[near] + 1e-10)
        flat = self.middle + np.asarray(uv) @ self.axes
        up = np.cross(*self.axes)
        return flat + up * float(weight @ ((self.places[near] - self.middle) @ up) / weight.sum())

    def patches(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (N*7,3), normals (N*7,3) and weights (7) of the patches under all probes."""
        turn = np.arange(6) * math.pi / 3.0
        flat = RING * self.reach * np.vstack([np.zeros((1, 2)), np.column_stack([np.cos(turn), np.sin(turn)])])
        share = np.array([1.0 - ON_RING, *(6 * [ON_RING / 6.0])])
        first = self.axes[0] - np.sum(self.axes[0] * self.normals, axis=1)[:, None] * self.normals
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(self.normals, first)
        points = self.places[:, None] + flat[:, 0, None] * first[:, None] + flat[:, 1, None] * second[:, None]
        return points.reshape(-1, 3), np.repeat(self.normals, len(flat), axis=0), share


class _Balls:
    """ln of the factor on the stiffness of each probe, over the numbers of the balls (j*4)."""

    def __init__(self, ground: Ground, ratio: float) -> None:
        self.ground, self.ratio = ground, ratio
        self.points, self.facing, self.weight = ground.patches()

    def centre(self, ball: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Position on the surface (3), centre (3), depth of the centre and radius."""
        radius = math.exp(ball[3])
        depth, position = math.exp(ball[2]) + radius, self.ground.surface_point(ball[:2])
        return position, nodule_centre(self.ground.places, self.ground.normals, position, depth), depth, radius

    def one(self, ball: np.ndarray) -> np.ndarray:
        _, centre, _, radius = self.centre(ball)
        reach = SHARPER * self.ground.reach
        factor = stiffness_map(self.points, self.facing, centre, radius, self.ratio, reach)
        return np.log(factor.reshape(len(self.ground.places), -1) @ self.weight)

    def overlap(self, balls: np.ndarray) -> bool:
        """Whether two balls share space."""
        each = [self.centre(ball)[1:] for ball in balls.reshape(-1, NUMBERS)]
        return any(
            float(np.linalg.norm(a[0] - b[0])) < APART * (a[2] + b[2]) for a, b in itertools.combinations(each, 2)
        )

    def __call__(self, balls: np.ndarray) -> np.ndarray:
        out = np.zeros(len(self.ground.places))
        for ball in balls.reshape(-1, NUMBERS):
            out += self.one(ball)
        return out


def find_inclusions(
    ground: Ground, values: np.ndarray, errors: np.ndarray, ratio: float
) -> tuple[list[Inclusion], Field, list[float]]:
    """Stiff balls, the field of the rest, and the criterion with 0, 1, 2 ... balls.

    values, errors (N)  ln K of the probes and its standard errors
    ratio               modulus of the balls over that of the tissue
    """
    balls, low, high = _Balls(ground, ratio), *_limits(ground)
    found, field = np.zeros(0), fit_field(ground.places, values, errors)
    scores = [field.loss]
    for count in range(1, MOST + 1):
        best = None
        for start in _starts(ground, field, values - balls(found), low, high):
            x, rest = _climb(balls, field, values, np.concatenate([found, start]), low, high)
            if not balls.overlap(x) and (best is None or rest.loss < best[1].loss):
                best = x, rest
        if best is None:
            break
        scores.append(best[1].loss + NUMBERS * count * math.log(len(values)))
        if scores[-1] > scores[-2] - CLEAR:
            break
        found, field = best
    draws = _draws(balls, field, values, found, low, high) if len(found) else np.zeros((1, 0))
    return [_summary(balls, draws[:, k : k + NUMBERS]) for k in range(0, len(found), NUMBERS)], field, scores


def _limits(ground: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and largest numbers of a ball."""
    plane, reach = ground.plane, ground.reach
    low, high = plane.min(axis=0) - reach, plane.max(axis=0) + reach
    wide = float(np.ptp(plane, axis=0).max())
    return (np.array([*low, math.log(0.02 * reach), math.log(0.2 * reach)]),
            np.array([*high, math.log(4.0 * reach), math.log(0.5 * wide)]))  # fmt: skip


def _starts(ground: Ground, field: Field, rest: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """First numbers of another ball: at the largest smoothed residuals, shallow and small, or deep and large."""
    near = np.exp(-((cdist(ground.places, ground.places) / ground.reach) ** 2))
    smooth = near @ (rest - np.median(rest)) / near.sum(axis=1)
    out, left = [], smooth.copy()
    for _ in range(PEAKS):
        at = int(np.argmax(left))
        left[cdist(ground.places[at : at + 1], ground.places)[0] < 3.0 * ground.reach] = -np.inf
        for top, size in ((0.3, 0.8), (1.0, 1.5)):
            ball = [*ground.plane[at], math.log(top * ground.reach), math.log(size * ground.reach)]
            out.append(np.clip(ball, low + 1e-6, high - 1e-6))
        if not np.isfinite(left).any():
            break
    return out


def _whitener(field: Field, hyper: np.ndarray | None = None) -> tuple[np.ndarray, float]:
    """Inverse of the Cholesky factor (N,N) of the covariance of the values, with an uncertain mean, and the logarithm
    of its determinant; `hyper`: logarithms of other amplitude, length and nugget."""
    a, length, b = (field.amplitude, field.length, field.nugget) if hyper is None else np.exp(hyper)
    cov = matern(cdist(field.places, field.places), a, length)
    cov += np.diag(field.errors**2 + b**2) + MEAN
    factor = cholesky(cov, lower=True)
    return solve_triangular(factor, np.eye(len(cov)), lower=True), -float(np.log(np.diag(factor)).sum())


def _climb(
    balls: _Balls, field: Field, values: np.ndarray, x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, Field]:
    """Balls and field with the largest restricted likelihood near these balls.

    A field would take over a ball that is missing: the balls are first fitted without one.
    """
    count, apart = len(x) // NUMBERS, cdist(field.places, field.places)
    ends = np.tile(low, count), np.tile(high, count)
    scale = np.tile([0.3 * balls.ground.reach] * 2 + [0.3] * 2, count)

    def rest(x: np.ndarray) -> np.ndarray:
        left = values - balls(x)
        return left - left.mean()

    inside = np.clip(x, ends[0] + 1e-9, ends[1] - 1e-9)
    x = least_squares(rest, inside, bounds=ends, x_scale=scale, diff_step=1e-3, max_nfev=30).x
    hyper = np.log([0.5 * np.std(rest(x)) + 1e-9, field.length, 0.5 * np.std(rest(x)) + 1e-9])

    def loss(y: np.ndarray) -> float:
        left = values - balls(y[: len(x)] * scale)
        return restricted_likelihood(apart, left, field.errors, *np.exp(y[len(x) :]))[0]

    first = np.concatenate([x / scale, hyper])
    bounds = [*zip(ends[0] / scale, ends[1] / scale, strict=True), *((value - 4.0, value + 4.0) for value in hyper)]
    y = minimize(loss, first, method="L-BFGS-B", bounds=bounds, options={"eps": 1e-4, "maxiter": 40}).x
    x, numbers = y[: len(x)] * scale, np.exp(y[len(x) :])
    lowest, mean, error = restricted_likelihood(apart, values - balls(x), field.errors, *numbers)
    amplitude, length, nugget = map(float, numbers)
    return x, Field(field.places, values - balls(x), field.errors, amplitude, length, nugget, mean, error, lowest)


def _draws(
    balls: _Balls, field: Field, values: np.ndarray, x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Draws (n, j*4) of the posterior of the balls and of the constants of the field, in turn; the steps adapt to the
    draws of the first part."""
    random, count = np.random.default_rng(0), len(x) // NUMBERS
    rest = values - field.mean - balls(x)
    parts = [balls.one(ball) for ball in x.reshape(-1, NUMBERS)]
    hyper = np.log([field.amplitude, field.length, max(field.nugget, 1e-3 * field.amplitude)])
    ends = hyper - 3.0, hyper + 3.0
    blocks = [slice(k * NUMBERS, (k + 1) * NUMBERS) for k in range(count)] + [slice(len(x), len(x) + 3)]
    now = np.concatenate([x, hyper])
    steps = [np.diag([0.1 * balls.ground.reach] * 2 + [0.1] * 2) for _ in range(count)] + [0.2 * np.eye(3)]
    white, log = _whitener(field, hyper)
    value, out = log - 0.5 * float(np.sum((white @ rest) ** 2)), np.empty((DRAWS, len(now)))
    for draw in range(DRAWS):
        k = draw % len(blocks)
        at = blocks[k]
        if draw and draw % 500 == 0 and draw <= BURN:
            for j, block in enumerate(blocks):
                past = out[draw // 2 : draw, block]
                size = past.shape[1]
                cov = np.cov(past.T) + np.diag(1e-6 * past.var(axis=0) + 1e-14)
                steps[j] = 2.38 / math.sqrt(size) * np.linalg.cholesky(cov)
        tried = now[at] + steps[k] @ random.standard_normal(at.stop - at.start)
        limits = ends if k == count else (low, high)
        if (tried > limits[0]).all() and (tried < limits[1]).all():
            part, new_rest, new_white, new_log = None, rest, white, log
            if k == count:
                new_white, new_log = _whitener(field, tried)
            else:
                part = balls.one(tried)
                new_rest = rest + parts[k] - part
            level = new_log - 0.5 * float(np.sum((new_white @ new_rest) ** 2))
            if math.log(random.random()) < level - value:
                now = now.copy()
                now[at], value, rest, white, log = tried, level, new_rest, new_white, new_log
                if part is not None:
                    parts[k] = part
        out[draw] = now
    return out[BURN:, : len(x)]


def _summary(balls: _Balls, draws: np.ndarray) -> Inclusion:
    middle = np.median(draws, axis=0)
    position, _, _, _ = balls.centre(middle)
    radius = np.exp(draws[:, 3])
    depth = np.exp(draws[:, 2]) + radius
    ends = np.quantile(draws[:, :2], [0.025, 0.975], axis=0)
    across = 0.5 * (ends[1] - ends[0])
    depths, radii = (np.quantile(one, [0.5, 0.025, 0.975]) for one in (depth, radius))
    return Inclusion(
        position, (float(across[0]), float(across[1])), (float(depths[0]), float(depths[1]), float(depths[2])),
        (float(radii[0]), float(radii[1]), float(radii[2])), float(np.exp(balls.one(middle).max())),
    )  # fmt: skip
