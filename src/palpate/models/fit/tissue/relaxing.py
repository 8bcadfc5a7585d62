"""Viscous and viscoelastic laws on an elastic force: Kelvin-Voigt, Hunt-Crossley, Prony series.

kelvin-voigt    F = F_e(s) + tau dF_e/dt
hunt-crossley   F = F_e(s) <1 + c s'>
prony:N         F = integral of g(t - t') dF_e(t'), N terms from the slowest to the fastest: quasi-linear
                viscoelasticity
"""

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import MeasuredPress
from palpate.models.fit.tissue.rigs import Law, Parameter, Values
from palpate.physics.materials.prony import relax_response, relaxed_slopes

KINDS = ("none", "kelvin-voigt", "hunt-crossley", "prony:1", "prony:2", "prony:3")


NEAR = 1e-6  # [1] Relative step of the indentation for the derivative of a law
SMALL, APART = 0.05, 1.4  # Share of a new term [1], and its distance in the logarithm of the time
JUMP = 0.15  # [1] Change of the rate in a row, over the largest rate, from which differences do not measure it


def measured_rows(kind: str, press: MeasuredPress) -> np.ndarray:
    """(n,) Which rows a fit of this kind counts: at the ends, and next to a row in which the indenter stops or starts,
    differences do not measure the rate on which the force depends."""
    counted = np.ones(len(press.depth), bool)
    if kind in ("kelvin-voigt", "hunt-crossley") and press.time is not None and len(counted) > 2:
        rates = np.diff(press.depth) / np.diff(press.time)
        jumps = np.flatnonzero(np.abs(np.diff(rates)) > JUMP * np.abs(rates).max()) + 1
        near = (jumps[:, None] + np.arange(-2, 3)).ravel()
        counted[np.r_[np.clip(near, 0, len(counted) - 1), 0, -1]] = False
    return counted


def contact_time(press: MeasuredPress) -> float:
    """Time [s] from the estimated touch to the last row of a press with times: the approach shows no relaxation."""
    assert press.time is not None
    first = min(int(np.argmax(press.depth > press.touch)), len(press.time) - 2)
    return float(press.time[-1] - press.time[first])


def parameters(kind: str, duration: float) -> tuple[Parameter, ...]:
    """Parameters of a kind of relaxation, with guesses for a contact of this length [s].

    SessionError: an unknown kind.
    """
    if kind not in KINDS:
        raise SessionError(f"--relaxation: found {kind!r}, expected {', '.join(KINDS)}")
    if kind == "kelvin-voigt":
        return (Parameter("retardation", "s", 0.02, 1e-6, 1e3),)
    if kind == "hunt-crossley":
        return (Parameter("damping", "s/m", 5.0, 1e-4, 1e5),)
    count = int(kind.partition(":")[2] or 0)
    times = duration * 0.2 * 0.1 ** np.arange(count)
    found: list[Parameter] = []
    for i, time in enumerate(times, 1):
        found += [Parameter(f"share_{i}", "1", 0.5 / count, 1e-4, 0.999, False),
                  Parameter(f"time_{i}", "s", float(time), 1e-4, 1e5)]  # fmt: skip
    return tuple(found)


def other_orders(kind: str, first: int, x: np.ndarray) -> list[np.ndarray]:
    """Starts for other minima of a Prony series, whose shares and times (as logarithms) are unknowns from `first` on.

    A short record hardly shows which terms it contains: they count as slower or faster by one place, and a small term
    takes the free place; or two neighbours are one term, and a small one is added at either end.
    """
    count = int(kind.partition(":")[2] or 0)
    if count < 2:
        return []
    last = first + 2 * count
    terms = x[first:last].reshape(count, 2)
    rest = np.concatenate([[1.0], np.cumprod(1.0 - terms[:, 0])])
    shares, times = terms[:, 0] * rest[:-1], np.minimum.accumulate(terms[:, 1])  # of the whole
    kept = [(np.delete(shares, k), np.delete(times, k)) for k in (0, count - 1)]
    for k in range(count - 1):
        both = shares[k] + shares[k + 1]
        time = float(shares[k : k + 2] @ times[k : k + 2]) / max(both, 1e-12)
        kept.append((np.r_[shares[:k], both, shares[k + 2 :]], np.r_[times[:k], time, times[k + 2 :]]))
    out = []
    for some, at in kept:
        for slower in (True, False):
            part, time = (SMALL, at[0] + APART) if slower else (SMALL, at[-1] - APART)
            each = np.r_[part, some] if slower else np.r_[some, part]
            each = each * min(1.0, 0.99 / max(float(each.sum()), 1e-12))
            left = 1.0 - np.concatenate([[0.0], np.cumsum(each[:-1])])
            y = x.copy()
            y[first:last] = np.stack([each / left, np.r_[time, at] if slower else np.r_[at, time]], axis=1).ravel()
            out.append(y)
    return out


def force(kind: str, law: Law, values: Values, press: MeasuredPress, touch: float) -> np.ndarray:
    """Force [N] (n,) of a law at the rows of a press that touches at `touch` [m]."""
    depth = press.depth - touch
    pressed = depth > 0.0
    elastic = np.zeros(len(depth))
    elastic[pressed] = law.force(values, depth[pressed])
    if kind == "none" or press.time is None:
        return elastic
    if kind == "kelvin-voigt":  # differences between rows would be wrong at the touch, where the force bends
        slope, s = np.zeros(len(depth)), depth[pressed]
        slope[pressed] = (law.force(values, s * (1.0 + NEAR)) - elastic[pressed]) / (s * NEAR)
        return np.maximum(elastic + values["retardation"] * slope * press.rate, 0.0)
    if kind == "hunt-crossley":
        return elastic * np.maximum(1.0 + values["damping"] * press.rate, 0.0)
    return relax_response(*_series(kind, values), press.time, elastic)


def has_slopes(kind: str) -> bool:
    """Whether `slopes` has the derivatives of this kind."""
    return kind.startswith("prony:")


def slopes(kind: str, law: Law, values: Values, press: MeasuredPress, touch: float) -> np.ndarray:
    """Derivatives [N] (n, 2 N) of the force by the shares and the logarithms of the times of a Prony series.

    The share of a term of the whole is g_i = s_i (1 - s_1) ... (1 - s_(i-1)): a later one falls by g_j/(1 - s_i).
    """
    assert press.time is not None  # of every fit with relaxation
    shares, times = _series(kind, values)
    by_whole = relaxed_slopes(shares, times, press.time, force("none", law, values, press, touch))
    given = [values[f"time_{i}"] for i in range(1, len(shares) + 1)]
    slowest = [given.index(time) for time in times]
    out, left = np.zeros_like(by_whole), 1.0
    for i in range(len(shares)):
        share = values[f"share_{i + 1}"]
        out[:, 2 * i] = left * by_whole[:, 2 * i] - by_whole[:, 2 * i + 2 :: 2] @ shares[i + 1 :] / (1.0 - share)
        left *= 1.0 - share
        out[:, 2 * slowest[i] + 1] += by_whole[:, 2 * i + 1]  # the parameter that is its time
    return out


def _series(kind: str, values: Values) -> tuple[np.ndarray, np.ndarray]:
    """Shares [1] of the whole and times [s] of a Prony series. Each parameter is a share of the remainder, so that the
    sum is below 1, and no term is slower than the one before it: else two terms could change their names."""
    shares, left = [], 1.0
    for i in range(1, int(kind.partition(":")[2]) + 1):
        shares.append(left * values[f"share_{i}"])
        left -= shares[-1]
    return np.array(shares), np.minimum.accumulate([values[f"time_{i}"] for i in range(1, len(shares) + 1)])
