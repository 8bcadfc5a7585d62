"""Coverage of the 95 % intervals of `palpate fit tissue`, its false alarms, and how often it detects a flaw of a press.

Noise: every law and rig, with white, correlated, quantised, drifting and gain noise; `python benchmarks/fit_coverage.py
noise [trials] [first seed] [case ...]`. `... drift [trials]`: width of the intervals with white noise, if the zero may
drift linearly or along a curve, over their width if it does not drift.

Coverage: a ball of 8 mm on a bonded layer of 20 mm, E = 10 kPa, noise of 1 % of the peak; the indentation in the file
has an offset of 0.1 mm. Two cases: a press without relaxation, and a press and hold with one Prony term.

Flaws: a ball of 8 mm on a half-space, pressed by 0.3 to 0.8 mm in 2 s; modulus, sampling rate, length of the approach,
noise (0.1 to 2 % of the peak) and size of the flaw are drawn at random.

python benchmarks/fit_coverage.py [trials] [first seed]
"""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from palpate.models.fit.tissue import relaxing
from palpate.models.fit.tissue.fit import TissueFit, fit_tissue
from palpate.models.fit.tissue.measured import MeasuredPress, prepare_press
from palpate.models.fit.tissue.rigs import Rig, closed_form

RIG = Rig("ball", 8e-3, 20e-3)
TRUTH = {"young": 1e4, "share_1": 0.5, "time_1": 2.0}
OFFSET = 1e-4
"""[m] Offset of the indentation in the file."""
FLAWS = {
    "none": ("",),
    "drift, 3 to 10 % of the peak": ("drift",),
    "begins at 10 to 40 % of the depth": ("no rows before contact",),
    "saturates at 40 to 80 % of the peak": ("saturated",),
    "same, noise after the limit": ("saturated",),
    "bonded layer of 5 to 8 mm": ("misfits",),
    "stiffens exponentially, 2 to 4 times": ("misfits",),
}
"""Flaw of a press -> words of the note that reports this flaw."""


def noise(count: int, correlation: float, rng: np.random.Generator) -> np.ndarray:
    """(count,) Noise of variance 1, first-order autoregressive with this correlation of neighbouring rows."""
    white = rng.standard_normal(count)
    for k in range(1, count):
        white[k] = correlation * white[k - 1] + math.sqrt(1.0 - correlation**2) * white[k]
    return white


def trial(
    seed: int, kind: str = "none", correlation: float = 0.0, size: float = 0.01, rows: int = 300
) -> MeasuredPress:
    """A press: 1 s of free motion, 2 s inward and, with a relaxing material, a hold until 9 s."""
    rng = np.random.default_rng(seed)
    time = np.linspace(-1.0, 9.0 if kind != "none" else 2.0, rows)
    depth = np.clip(time / 2.0, -0.5, 1.0) * 2e-3
    ideal = MeasuredPress("synthetic", time, depth, np.zeros(rows), 0.0, 1e-4, 0.0)
    force = relaxing.force(kind, closed_form(RIG, "layer"), TRUTH, ideal, 0.0)
    return prepare_press("synthetic", time, depth + OFFSET, force + size * force.max() * noise(rows, correlation, rng))


def covered(trials: int, kind: str, correlation: float, first: int = 0) -> dict[str, float]:
    """Share of trials whose interval contains the true value, for each parameter, and share with a false alarm."""
    held: dict[str, list[bool]] = {}
    for seed in range(first, first + trials):
        fit = fit_tissue([trial(seed, kind, correlation)], RIG, "layer", kind)
        for name, interval in fit.estimate.intervals.items():
            held.setdefault(name, []).append(interval.low <= TRUTH[name] <= interval.high)
        held.setdefault("false alarm", []).append(bool(fit.notes))
    return {name: float(np.mean(each)) for name, each in held.items()}


CYLINDER = Rig("cylinder", 25e-3, 30e-3)
CASES: dict[str, tuple[Rig, str, dict[str, float], str, float]] = {
    "hertz, ball": (Rig("ball", 30e-3), "hertz", {"young": 1e4}, "none", 2e-3),
    "layer": (RIG, "layer", {"young": 1e4}, "none", 2e-3),
    "exponential": (RIG, "exponential", {"stiffness": 100.0, "hardening": 600.0}, "none", 2e-3),
    "power": (RIG, "power", {"stiffness": 3e3, "exponent": 1.5}, "none", 2e-3),
    "hertz, punch": (Rig("punch", 20e-3), "hertz", {"young": 1e4}, "none", 2e-3),
    "fingertip": (Rig("fingertip"), "power", {"stiffness": 3e3, "exponent": 1.5}, "none", 2e-3),
    "kelvin-voigt": (RIG, "layer", {"young": 1e4, "retardation": 0.2}, "kelvin-voigt", 2e-3),
    "prony:1": (RIG, "layer", TRUTH, "prony:1", 2e-3),
    "neo_hooke": (CYLINDER, "neo_hooke", {"young": 2e4}, "none", 10e-3),
    "yeoh": (CYLINDER, "yeoh", {"young": 2e4, "c2_over_c1": 0.1}, "none", 10e-3),
    "demiray": (CYLINDER, "demiray", {"young": 2e4, "b": 1.0}, "none", 10e-3),
}
"""Rig, law, true values, relaxation, depth [m]."""
NOISES = ("white", "correlated", "quantised", "drift", "bent drift", "gain", "bent drift from contact")


def noisy(case: str, what: str, seed: int, rows: int = 300) -> MeasuredPress:
    """A press of a case: 1 s of free motion, 2 s inward, then a hold if it relaxes, with one kind of noise:

    white, correlated  1 % of the peak, correlation 0 and 0.9
    quantised          a step of 2 % of the peak, noise of 0.3 % before it, a zero anywhere in a step
    drift, bent drift  2 % of the peak over the record, linear or quadratic in time, with white noise of 0.5 %
    gain               2 % of the force, correlation 0.9, with white noise of 0.1 % of the peak

    "from contact": without the rows before contact.
    """
    rig, law, truth, kind, reach = CASES[case]
    rng = np.random.default_rng(seed)
    begin = 0.0 if "from contact" in what else -1.0
    time = np.linspace(begin, {"none": 2.0, "kelvin-voigt": 4.0}.get(kind, 10.0), rows)
    depth = np.clip(time / 2.0, -0.5, 1.0) * reach
    ideal = MeasuredPress("synthetic", time, depth, np.zeros(rows), 0.0, 1e-4, 0.0)
    force = relaxing.force(kind, closed_form(rig, law), truth, ideal, 0.0)
    peak, share = float(force.max()), (time - time[0]) / np.ptp(time)
    if what == "gain":
        force = force * (1.0 + 0.02 * noise(rows, 0.9, rng)) + 0.001 * peak * noise(rows, 0.0, rng)
    elif what == "quantised":
        step = 0.02 * peak
        force = step * np.round((force + 0.003 * peak * noise(rows, 0.0, rng)) / step + rng.uniform())
    elif "drift" in what:
        curved = share**2 if "bent" in what else share
        force = force + peak * (0.005 * noise(rows, 0.0, rng) + rng.choice((-1.0, 1.0)) * 0.02 * curved)
    else:
        force = force + 0.01 * peak * noise(rows, 0.9 if what == "correlated" else 0.0, rng)
    return prepare_press("synthetic", time, depth + OFFSET, force)


def by_noise(case: str, what: str, trials: int, first: int = 0) -> dict[str, float]:
    """Share of the intervals given that contain the true value, of those withheld, and of misses without a note."""
    rig, law, truth, kind, _ = CASES[case]
    held: dict[str, list[bool]] = {"withheld": [], "silent miss": []}
    for seed in range(first, first + trials):
        fit = fit_tissue([noisy(case, what, seed)], rig, law, kind)
        inside = {name: i.low <= truth[name] <= i.high for name, i in fit.estimate.intervals.items()}
        held["withheld"].append(fit.estimate.withheld)
        held["silent miss"].append(not all(inside.values()) and not fit.notes)
        for name, each in inside.items() if not fit.estimate.withheld else ():
            held.setdefault(name, []).append(each)
    return {name: float(np.mean(each)) for name, each in held.items()}


def widened(case: str, drift: str, trials: int, first: int = 0) -> str:
    """Width of each interval with white noise, over its width if the zero does not drift: median and range."""
    rig, law, truth, kind, _ = CASES[case]
    ratios: dict[str, list[float]] = {name: [] for name in truth}
    for seed in range(first, first + trials):
        press = noisy(case, "white", seed)
        fits = [fit_tissue([press], rig, law, kind, drift=how).estimate.intervals for how in (drift, "none")]
        for name in truth:
            widths = [fit[name].high - fit[name].low for fit in fits]
            ratios[name].append(widths[0] / widths[1])
    middle = {name: f"{np.median(each):.2g} ({min(each):.2g} to {max(each):.2g})" for name, each in ratios.items()}
    return ", ".join(f"{name} {text}" for name, text in middle.items())


def flawed(flaw: str, correlation: float, seed: int) -> tuple[TissueFit, float, bool]:
    """Fit of Hertz's law to a press with a flaw, the true modulus [Pa], and whether the flaw exceeds the noise.

    It exceeds the noise if the RMS residual of Hertz's law, fitted to the force without noise, is greater than the RMS
    of the noise.
    """
    # draw the press: modulus, depth, sampling rate, length of the approach, noise, size of the flaw
    rng = np.random.default_rng(seed)
    young, reach = 10 ** rng.uniform(3.0, 4.7), rng.uniform(0.3e-3, 0.8e-3)
    rate, air, size = 10 ** rng.uniform(1.6, 2.3), rng.uniform(0.4, 1.0), 10 ** rng.uniform(-3.0, -1.7)
    large = rng.uniform()
    time = np.arange(0.0, air + 2.0, 1.0 / rate)
    depth = (time - air) / 2.0 * reach
    # ideal force: Hertz with nu = 0.5, with a flaw of the tissue if the trial has one
    s = np.maximum(depth, 0.0)
    force = 16 / 9 * young * math.sqrt(RIG.radius) * s**1.5
    if "layer" in flaw:  # E. K. Dimitriadis et al., Biophys. J. 82 (2002) 2798
        chi = np.sqrt(RIG.radius * s) / ((5.0 + 3.0 * large) * 1e-3)
        force *= 1.0 + 1.133 * chi + 1.283 * chi**2 + 0.769 * chi**3 + 0.0975 * chi**4
    if "stiffens" in flaw:
        force *= np.exp(math.log(2.0 + 2.0 * large) * s / reach)
    # flaws of the measurement: saturation, drift, missing rows before contact
    peak = force.max()
    limit = peak * (0.4 + 0.4 * large if "limit" in flaw or "saturates" in flaw else math.inf)
    error = size * peak * noise(len(time), correlation, rng)
    drift = (0.03 + 0.07 * large) * peak * time / time[-1] if "drift" in flaw else 0.0
    exceeds = residual(depth, np.minimum(force, limit) + drift) > size * peak
    force = np.minimum(force, limit) + error if "limit" in flaw else np.minimum(force + error, limit)
    force = force + rng.choice((-1.0, 1.0)) * drift if "drift" in flaw else force
    kept = depth >= ((0.1 + 0.3 * large) * reach if "begins" in flaw else -1.0)
    force = force - (force[kept][:3].mean() if "begins" in flaw else 0.0)
    return fit_tissue([prepare_press("press.csv", time[kept], depth[kept], force[kept])], RIG, "hertz"), young, exceeds


def residual(depth: np.ndarray, force: np.ndarray) -> float:
    """RMS residual [N] of Hertz's law with fitted touch point and fitted zero of the force."""
    x, y = depth / depth.max(), force / force.max()
    off = least_squares(lambda q: q[0] * np.maximum(x - q[1], 0.0) ** 1.5 + q[2] - y, (1.0, 0.0, 0.0)).fun
    return float(np.sqrt(np.mean(off**2)) * force.max())


def detected(flaw: str, correlation: float, trials: int, first: int = 0) -> dict[str, float]:
    """Shares of the trials: flaw noted, another note, interval withheld, interval with the true value; wrong interval
    without a note, of all trials and of those whose flaw exceeds the noise."""
    rows: list[dict[str, Any]] = []
    words = FLAWS[flaw]
    for seed in range(first, first + trials):
        fit, young, exceeds = flawed(flaw, correlation, seed)
        interval = fit.estimate.intervals["young"]
        found = [bool(words[0]) and any(word in note for word in words) for note in fit.notes]
        rows.append({
            "noted": any(found), "another note": not all(found), "withheld": fit.estimate.withheld,
            "contains the true value": not fit.estimate.withheld and interval.low <= young <= interval.high,
            "wrong without a note": not fit.notes and not interval.low <= young <= interval.high,
            "exceeds the noise": exceeds,
        })  # fmt: skip
    shares = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    large = [row["wrong without a note"] for row in rows if row["exceeds the noise"]]
    return shares | {"wrong without a note where it exceeds": float(np.mean(large)) if large else 0.0}


def main() -> None:
    if sys.argv[1:2] == ["noise"]:
        trials, first = (int(text) for text in (sys.argv[2:4] + ["200", "0"][len(sys.argv[2:4]) :]))
        for case in sys.argv[4:] or CASES:
            for what in NOISES:
                _print(case, what, by_noise(case, what, trials, first))
        return
    if sys.argv[1:2] == ["drift"]:
        for case in CASES:
            for drift in ("linear", "curved"):
                print(f"{case}, {drift}: {widened(case, drift, int((sys.argv[2:] or ['20'])[0]))}", flush=True)
        return
    trials, first = (int(text) for text in (sys.argv[1:] + ["200", "0"][len(sys.argv) - 1 :]))
    for kind in ("none", "prony:1"):
        for correlation in (0.0, 0.9):
            _print(f"relaxation {kind}", correlation, covered(trials, kind, correlation, first))
    for flaw in FLAWS:
        for correlation in (0.0, 0.9):
            _print(flaw, correlation, detected(flaw, correlation, trials, first))


def _print(title: str, correlation: float | str, shares: dict[str, float]) -> None:
    text = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
    noise_of = correlation if isinstance(correlation, str) else f"correlation {correlation:g}"
    print(f"{title}, {noise_of}: {text}", flush=True)


if __name__ == "__main__":
    main()
