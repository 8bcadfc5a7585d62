"""One law for many sparse probes of an organ: a mixed-effects fit.

    F_ij = K_i phi(<d_ij - t_i>; c) + z_i + e_ij,   e_ij ~ N(0, s²)
    ln K_i ~ N(mu, tau²),   t_i ~ N(t0, s_t²),   z_i ~ N(z0, s_z²)

for row j of probe i: depth d [m], force F [N], law phi with constants c common to all probes, touch point t [m] and
zero of the force z [N]. A probe of ten rows does not determine its three numbers; their common distribution does. Two
steps alternate: the modes of (ln K_i, t_i, z_i) for known variances, and restricted maximum likelihood of the linear
mixed-effects model at these modes for the means, c and the variances (M. J. Lindstrom, D. M. Bates, Biometrics 46,
1990, 673). Intervals are those of the linear model, with Student's t of the number of probes.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2
from scipy.stats import t as student

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.rigs import Law

STEPS = 12  # Gauss-Newton steps of the modes of all probes
LONGEST = 1.0  # [1] Longest step of the mean ln K in a turn
TURNS = 40  # of linearisation and linear fit
FAR = 12.0  # Largest distance of ln K of a probe from the mean
FURTHEST = 2.0  # [1] Largest distance of a touch point from 0, over the greatest depth
MM = 1e-3  # [m] Scale of the touch points
LEAST_PROBES = 8
RARE = 1e-3  # p-value below which the law does not follow the mean curve
DRIFTING = 0.2  # [1] Spread of the first forces over the rise of a probe that only zeros that drift have
AIR = 0.02  # [1] Least way before contact, over that of a probe, from which the law's constants are determined
BINS = 6  # of the depth, in the test for misfit


@dataclass(frozen=True)
class Rows:
    """Rows of N probes, padded to R: depth [m] (N,R) and force [N] (N,R), valid where `mask` (N,R)."""

    depth: np.ndarray
    force: np.ndarray
    mask: np.ndarray

    @staticmethod
    def of(depths: Sequence[np.ndarray], forces: Sequence[np.ndarray]) -> "Rows":
        most = max(map(len, depths))
        depth, force, mask = np.zeros((3, len(depths), most))
        for i, (d, f) in enumerate(zip(depths, forces, strict=True)):
            depth[i, : len(d)], force[i, : len(d)], mask[i, : len(d)] = d, f, 1.0
        return Rows(depth, force, mask.astype(bool))


@dataclass
class PooledFit:
    """A pooled fit.

    values     common constants of the law, and its stiffness at the median of all places
    intervals  95 % intervals of these; `withheld`: the reason why they are not valid, or ""
    limited    which constant of the law lies at a limit of its range, or ""
    spread     standard deviation of ln K between places; `between`: range of 95 % of the places
    touch, zero  mean and standard deviation of the touch point [m] and of the zero of the force [N]
    noise      standard deviation [N]
    place, error   ln K of each probe and its standard error, without the other probes
    shrunk, shrunk_error, touches  ln K, its standard error and the touch point of each probe, with them
    fitted     force [N] (N,R)
    """

    law: Law
    rows: Rows
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    spread: float
    touch: tuple[float, float]
    zero: tuple[float, float]
    noise: float
    place: np.ndarray
    error: np.ndarray
    shrunk: np.ndarray
    shrunk_error: np.ndarray
    touches: np.ndarray
    fitted: np.ndarray
    withheld: str = ""
    limited: str = ""
    notes: list[str] = field(default_factory=list)

    @property
    def first(self) -> str:
        """Name of the number that differs between places."""
        return self.law.parameters[0].name

    @property
    def between(self) -> tuple[float, float]:
        """Range of 95 % of the places."""
        wide = math.exp(1.959964 * self.spread)
        return self.values[self.first] / wide, self.values[self.first] * wide

    def force(self, log_stiffness: float, touch: float, depth: np.ndarray) -> np.ndarray:
        """Force [N] at depths [m] of a probe with this ln K and touch point [m], and the mean zero of the force."""
        shape = {**self.values, self.first: 1.0}
        return self.zero[0] + math.exp(log_stiffness) * self.law.force(shape, np.maximum(depth - touch, 0.0))


@dataclass
class _State:
    """Means (ln of the force at the greatest depth, t [mm], z [N]), logarithms of the standard deviations (of ln K,
    t [mm], z, e), and the constants of the law in search coordinates."""

    mean: np.ndarray
    deviations: np.ndarray
    shape: np.ndarray

    def near(self, other: "_State") -> bool:
        noise = math.exp(self.deviations[3])
        return np.allclose(self.mean / [1.0, 1.0, noise], other.mean / [1.0, 1.0, noise], rtol=0.0, atol=1e-3) and all(
            np.allclose(getattr(self, k), getattr(other, k), rtol=0.0, atol=1e-3) for k in ("deviations", "shape")
        )


class _Model:
    """Modes and linearisation of the probes for one state of the model."""

    def __init__(self, rows: Rows, law: Law) -> None:
        self.rows, self.law = rows, law
        self.modes: np.ndarray | None = None
        self.reach = float((rows.depth * rows.mask).max())
        self.bounds = [(p.to_search(p.low), p.to_search(p.high)) for p in law.parameters[1:]]

    def start(self) -> _State:
        first, peaks = self.rows.force[:, 0], np.where(self.rows.mask, self.rows.force, -np.inf).max(axis=1)
        middle, size = float(np.median(first)), float(np.median(peaks - first))
        apart = float(first.std())  # much of it: the zero drifts from probe to probe
        zero = apart if apart > DRIFTING * size else 0.02 * size
        shape = [p.to_search(p.guess) for p in self.law.parameters[1:]]
        wide = [0.5, 0.1 + 50.0 * self.reach, zero, 0.05 * size]
        return _State(np.array([math.log(size), 0.0, middle]), np.log(wide), np.array(shape))

    def scale(self, shape: np.ndarray) -> float:
        """ln of the force at the greatest depth with K = 1. ln K and the constants of the law are strongly correlated,
        the force there and the constants are not."""
        return math.log(float(self._bare(shape, np.array([self.reach]))[0]))

    def _bare(self, shape: np.ndarray, s: np.ndarray) -> np.ndarray:
        """The law with K = 1 at indentations of any shape."""
        first, *rest = self.law.parameters
        values = {first.name: 1.0} | {p.name: p.value(v) for p, v in zip(rest, shape, strict=False)}
        s = np.maximum(s, 0.0)
        return self.law.force(values, s.ravel()).reshape(s.shape)

    def linear(self, state: _State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Forces (N,R) at the modes, the modes (N,3), and the slopes (N,R,3+p) over the numbers of a probe and the
        constants of the law."""
        rows, shape = self.rows, state.shape
        whole = math.exp(self.scale(shape))
        mean, scale = state.mean, np.exp(state.deviations[:3])
        sure, step = math.exp(-state.deviations[3]), 1e-7
        v = np.zeros((len(rows.depth), 3)) if self.modes is None else np.clip((self.modes - mean) / scale, -8.0, 8.0)

        def place(v: np.ndarray) -> np.ndarray:
            u = mean + scale * v
            u[:, 0] = np.clip(u[:, 0], mean[0] - FAR, mean[0] + FAR)
            u[:, 1] = np.clip(u[:, 1], -FURTHEST * self.reach / MM, FURTHEST * self.reach / MM)
            return u

        def forces(u: np.ndarray) -> np.ndarray:
            return np.exp(u[:, 0])[:, None] * self._bare(shape, rows.depth - MM * u[:, 1, None]) / whole

        def loss(v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            u = place(v)
            bare = forces(u)
            rest = np.where(rows.mask, (bare + u[:, 2, None] - rows.force) * sure, 0.0)
            return np.sum(rest**2, axis=1) + np.sum(v**2, axis=1), rest, bare

        def slopes(u: np.ndarray, bare: np.ndarray) -> np.ndarray:
            side = np.array([0.0, step / MM, 0.0])
            along = (forces(u - side) - forces(u + side)) / (2.0 * step)
            return np.stack([bare, -MM * along, np.ones_like(bare)], axis=2) * rows.mask[:, :, None]

        v, bare = _descend(v, loss, lambda v, bare: slopes(place(v), bare) * scale * sure)
        self.modes = u = place(v)
        columns = [slopes(u, bare)]
        for k in range(len(shape)):
            sides = [shape + sign * 1e-5 * np.eye(len(shape))[k] for sign in (1.0, -1.0)]
            up, down = (
                np.exp(u[:, 0])[:, None] * self._bare(c, rows.depth - MM * u[:, 1, None]) / math.exp(self.scale(c))
                for c in sides
            )
            columns.append(((up - down) / 2e-5 * rows.mask)[:, :, None])
        return bare + u[:, 2, None], u, np.concatenate(columns, axis=2)


def _descend(
    v: np.ndarray,
    loss: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]],
    slopes: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """The numbers (N,3) of all probes at which each has its least loss, and the forces there, by the method of
    Levenberg and Marquardt for all probes at once.

    loss    the sum of squares (N) with the prior |v|², the residuals and the forces
    slopes  the derivatives of the residuals by v, from v and the forces
    """
    value, rest, bare = loss(v)
    damp = np.full(len(v), 1e-4)
    for _ in range(STEPS):
        jacobian = slopes(v, bare)
        H = np.einsum("nri,nrj->nij", jacobian, jacobian) + np.eye(3)
        damped = H + damp[:, None, None] * np.einsum("nii->ni", H)[:, :, None] * np.eye(3)
        gradient = np.einsum("nri,nr->ni", jacobian, rest) + v
        move = np.linalg.solve(damped, gradient[:, :, None])[:, :, 0]
        tried, tried_rest, tried_bare = loss(v - move)
        better = tried <= value
        v[better], value[better] = (v - move)[better], tried[better]
        rest[better], bare[better] = tried_rest[better], tried_bare[better]
        damp = np.where(better, np.maximum(0.1 * damp, 1e-12), 10.0 * damp)
        if float(np.abs(move).max()) < 1e-6:
            break
    return v, bare


class _Linear:
    """The linear mixed-effects model y = X b + J v + e of one linearisation, from the Gram matrices of each probe.

    jacobian (N,R,3+p) and y (N,R); X has the columns of J, and the constants of the law.
    """

    def __init__(self, jacobian: np.ndarray, y: np.ndarray, count: np.ndarray) -> None:
        J = jacobian[:, :, :3]
        Xy = np.concatenate([jacobian, y[:, :, None]], axis=2)
        self.JJ, self.JX = (np.einsum("nri,nrj->nij", J, other) for other in (J, Xy))
        self.XX, self.count = np.einsum("nri,nrj->ij", Xy, Xy), count

    def solve(self, deviations: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """-2 ln restricted likelihood, b (3+p), and the covariance of b."""
        D, s2 = np.exp(deviations[:3]), math.exp(2.0 * deviations[3])
        M = s2 * np.eye(3) + D[:, None] * self.JJ * D
        DJX = D[:, None] * self.JX
        gram = (self.XX - np.einsum("nki,nkj->ij", DJX, np.linalg.solve(M, DJX))) / s2
        cov = np.linalg.pinv(gram[:-1, :-1], hermitian=True)
        b = cov @ gram[:-1, -1]
        rest = float(gram[-1, -1] - gram[:-1, -1] @ b)
        logs = float(((self.count - 3) * math.log(s2) + np.linalg.slogdet(M)[1]).sum())
        return rest + logs + float(np.linalg.slogdet(gram[:-1, :-1])[1]), b, cov


def fit_pooled(rows: Rows, law: Law) -> PooledFit:
    """Fit a law to the probes. SessionError: too few of them."""
    if len(rows.depth) < LEAST_PROBES:
        raise SessionError(f"{len(rows.depth)} probes remain, expected at least {LEAST_PROBES} for a pooled fit")
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # of trial steps, which are then rejected
            fitted = _fit(rows, law)
    except (np.linalg.LinAlgError, ArithmeticError, ValueError):
        raise SessionError(
            f"law {law.name}: its search leaves the range of numbers on these {len(rows.depth)} probes, which do not "
            "determine it; take another --law, or more probes with a larger force over their noise"
        ) from None
    for parameter in law.parameters[1:]:
        if parameter.at_limit(fitted.values[parameter.name]):
            fitted.limited = f"{parameter.name} lies at the limit of its range, {fitted.values[parameter.name]:g}"
            fitted.withheld = f"{fitted.limited}: the law does not follow the probes, or they do not determine it"
    first, (low, high) = law.parameters[0], fitted.intervals[fitted.first]
    if first.at_limit(low) or first.at_limit(high):
        fitted.withheld = fitted.withheld or f"the probes do not determine {first.name}: its interval has no end"
    away, worst, p = misfit(fitted)
    if p < RARE:
        text = (
            f"the mean curve of all probes differs from the law {law.name} by up to {100.0 * worst:.2g} % of its "
            f"peak at {1e3 * away:.2g} mm (p = {p:.1g})"
        )
        if fitted.first == "young":
            fitted.withheld = (
                fitted.withheld or f"{text}, so its modulus has no true value; try --law power or exponential"
            )
        else:
            fitted.notes.append(f"{text}; the numbers describe the curves within this error")
    late, span = float(np.median(rows.depth[:, 0] - fitted.touches)), float(np.ptp(rows.depth[rows.mask]))
    if len(law.parameters) > 1 and late > -AIR * span:
        fitted.withheld = fitted.withheld or (
            "half of the probes or more have no row before contact, so that touch points, zeros and the constants of "
            f"the law {law.name} are extrapolated; begin probes above the surface"
        )
    return fitted


def _fit(rows: Rows, law: Law) -> PooledFit:
    model, count = _Model(rows, law), rows.mask.sum(axis=1)
    state = model.start()
    limits = [(value - 9.0, value + 2.5) for value in state.deviations]
    for turn in range(TURNS):
        forces, u, jacobian = _finite(*model.linear(state))
        known = np.einsum("nrk,nk->nr", jacobian[:, :, :3], u) + jacobian[:, :, 3:] @ state.shape
        linear = _Linear(jacobian, np.where(rows.mask, rows.force - forces, 0.0) + known, count)
        loss = lambda x, linear=linear: linear.solve(x)[0]  # noqa: E731
        found = minimize(loss, state.deviations, method="L-BFGS-B", bounds=limits)
        _, b, cov = linear.solve(found.x)
        share = 0.5 ** (turn // 10)  # a law with a corner at the touch point may alternate between two states
        low, high = np.array(model.bounds).reshape(-1, 2).T
        shape = np.clip(state.shape + np.clip(b[3:] - state.shape, -1.0, 1.0), low, high)
        mean = b[:3] + cov[:3, 3:] @ np.linalg.pinv(cov[3:, 3:], hermitian=True) @ (shape - b[3:])  # given the shape
        # far from the minimum the linear fit is no guide: limit the steps of ln K and of the touch point
        most = np.array([LONGEST, 0.5 * model.reach / MM, np.inf])
        mean = state.mean + np.clip(mean - state.mean, -most, most)
        new = _State(state.mean + share * (mean - state.mean), state.deviations + share * (found.x - state.deviations),
                     state.shape + share * (shape - state.shape))  # fmt: skip
        done, state = new.near(state), new
        if done:
            break
    forces, u, jacobian = _finite(*model.linear(state))
    quantile = float(student.ppf(0.975, len(u) - 1))
    values, intervals = _constants(model, state, cov, quantile)
    unit = model.scale(state.shape)
    # what each probe says without the common distribution of ln K
    D, s2 = np.exp(state.deviations[:3]), math.exp(2.0 * state.deviations[3])
    JJ = np.einsum("nri,nrj->nij", jacobian[:, :, :3], jacobian[:, :, :3])
    post = np.linalg.inv(JJ / s2 + np.diag(D**-2.0))[:, 0, 0]
    error2 = 1.0 / np.maximum(1.0 / post - D[0] ** -2.0, 1e-6)
    place = error2 * (u[:, 0] / post - state.mean[0] / D[0] ** 2) - unit
    return PooledFit(
        law, rows, values, intervals, float(D[0]), (float(MM * state.mean[1]), float(MM * D[1])),
        (float(state.mean[2]), float(D[2])), math.sqrt(s2), place, np.sqrt(error2), u[:, 0] - unit, np.sqrt(post),
        MM * u[:, 1], forces,
    )  # fmt: skip


def _constants(
    model: _Model, state: _State, cov: np.ndarray, quantile: float
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """K and the constants of the law, with their intervals."""
    slope = np.zeros(3 + len(state.shape))
    slope[0] = 1.0
    for k in range(len(state.shape)):
        side = 1e-4 * np.eye(len(state.shape))[k]
        slope[3 + k] = -(model.scale(state.shape + side) - model.scale(state.shape - side)) / 2e-4
    unit = model.scale(state.shape)
    middle, half = state.mean[0] - unit, quantile * math.sqrt(slope @ cov @ slope)
    first, *rest = model.law.parameters
    values = {first.name: math.exp(middle)}
    # an interval of places that do not determine K ends at the range of its values, not of numbers
    low, high = min(math.log(first.low), middle), max(math.log(first.high), middle)
    intervals = {first.name: (math.exp(max(middle - half, low)), math.exp(min(middle + half, high)))}
    for k, parameter in enumerate(rest):
        at, half = state.shape[k], quantile * math.sqrt(cov[3 + k, 3 + k])
        ends = np.clip([at - half, at + half], *model.bounds[k])
        values[parameter.name] = parameter.value(at)
        intervals[parameter.name] = parameter.value(ends[0]), parameter.value(ends[1])
    return values, intervals


def _finite(*arrays: np.ndarray) -> tuple[np.ndarray, ...]:
    """The arrays. FloatingPointError: one has a number that is not finite, or whose square is not."""
    if not all(np.isfinite(array).all() and float(np.abs(array).max(initial=0.0)) < 1e150 for array in arrays):
        raise FloatingPointError
    return arrays


def misfit(fit: PooledFit) -> tuple[float, float, float]:
    """Depth [m] and size, over the mean peak, of the largest mean residual, and the p-value of all mean residuals.

    Probes are independent, the rows of a probe are not: each bin of depth has one mean residual per probe.
    """
    rows = fit.rows
    deep = rows.depth - fit.touches[:, None]
    inside = rows.mask & (deep > 0.0)
    edges = np.quantile(deep[inside], np.linspace(0.0, 1.0, BINS + 1))
    rest = rows.force - fit.fitted
    means, depths = [], []
    for low, high in itertools.pairwise(edges):
        here = inside & (deep >= low) & (deep <= high)
        count = here.sum(axis=1)
        means.append(np.where(count, (rest * here).sum(axis=1) / np.maximum(count, 1), np.nan))
        depths.append(0.5 * (low + high))
    table = np.array(means).T
    mean, n = np.nanmean(table, axis=0), np.sum(np.isfinite(table), axis=0)
    error = np.nanstd(table, axis=0) / np.sqrt(np.maximum(n - 1, 1))
    peak = float(np.mean(np.where(rows.mask, rows.force, -np.inf).max(axis=1)))
    k = int(np.argmax(np.abs(mean)))
    return depths[k], abs(float(mean[k])) / peak, float(chi2.sf(np.sum((mean / error) ** 2), BINS))
