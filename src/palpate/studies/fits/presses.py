"""Random presses: motion of the indenter, force of the law, and what sensors, specimens and instruments add to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.studies.fits.cases import CASES, Case
from palpate.studies.fits.tables import TABULATED, draw_tabulated
from palpate.studies.fits.truth import true_force

NAMES = (*CASES, *TABULATED)
NOISES = ("white", "correlated", "gain", "hum", "heavy-tailed")
SHALLOW, FEW = 0.05, 30  # share of the travel in contact [1], and rows in contact, below which they are a stratum
MOST_ROWS = 4000


@dataclass(frozen=True)
class RandomPress:
    """A press with its true parameters. `flaws` are its strata: name -> size (share of the peak, or number)."""

    case: Case
    time: np.ndarray
    depth: np.ndarray
    force: np.ndarray
    noise: str
    flaws: dict[str, float]

    def plain(self) -> dict[str, Any]:
        """For the report: what distinguishes this press."""
        return {"noise": self.noise, **{name: float(f"{size:.3g}") for name, size in self.flaws.items()}}


def draw_press(name: str, seed: int, number: int, folder: Path | None = None) -> RandomPress:
    """Press `number` of a case; the same numbers give the same press. `folder` has the tables of finite elements."""
    rng = np.random.default_rng([seed, NAMES.index(name), number])
    case = CASES[name](rng) if name in CASES else draw_tabulated(name, rng, folder)
    flaws: dict[str, float] = {}
    time, path, jitter = _motion(case, rng, flaws)
    depth, force = true_force(case, time, path)
    depth = depth + jitter
    peak, top = float(force.max()), int(np.argmax(depth))
    if case.relaxation == "none" and "hysteresis" in flaws:
        force[top:] *= 1.0 - flaws["hysteresis"] * _fade(len(force) - top)
    if case.relaxation == "none" and "hold" in flaws:
        held = np.arange(len(force)) > top
        force[held] *= 1.0 - 0.5 * flaws["hold"]
    force = force + peak * _baseline(time, depth, rng, flaws)
    kind = str(rng.choice(NOISES))
    force = force + peak * _noise(kind, force / peak, rng, flaws)
    if rng.uniform() < 0.3:
        flaws["quantised"] = _spread(rng, 1e-3, 3e-2)
        step = flaws["quantised"] * peak
        force = step * np.round(force / step + rng.uniform())
    flaws["zero"] = rng.uniform(-2.0, 2.0) * (rng.uniform() < 0.5)
    if not flaws["zero"]:
        del flaws["zero"]
    return RandomPress(case, time, depth + rng.uniform(-1.0, 1.0) * case.reach, force + peak * flaws.get("zero", 0.0),
                       kind, flaws)  # fmt: skip


def _spread(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def _fade(count: int) -> np.ndarray:
    """0 to 1 within 10 % of the rows: the force leaves the loading curve where the motion turns."""
    return np.minimum(np.arange(count) / max(0.1 * count, 1.0), 1.0)


def _motion(case: Case, rng: np.random.Generator, flaws: dict[str, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s] (n) and depth [m] (n) below the surface: approach, press, perhaps hold, return and a second cycle; error
    [m] (n) of the measured depth."""
    inside = int(_spread(rng, 12, 400))
    share = _spread(rng, 0.008, 0.9)
    outside = min(int(inside / share) - inside, MOST_ROWS - 2 * inside)
    if rng.uniform() < 0.06:
        outside, flaws["from contact"] = 0, 1.0
    else:
        outside = max(outside, 3)
    share = inside / (inside + outside)
    flaws |= {"shallow": share} if share < SHALLOW else {}
    flaws |= {"few rows": float(inside)} if inside < FEW else {}
    step = case.reach / inside
    path = [np.linspace(-outside * step, case.reach, inside + outside)]
    if case.relaxation != "none" or rng.uniform() < 0.15:
        flaws["hold"] = rng.uniform(0.0, 0.3)
        path.append(np.full(inside if case.relaxation != "none" else max(inside // 2, 3), case.reach))
    if case.relaxation == "none" and rng.uniform() < 0.5:
        flaws["hysteresis"] = rng.uniform(0.0, 0.4)
        path.append(path[0][::-1])
        if rng.uniform() < 0.3 and sum(map(len, path)) < MOST_ROWS:
            flaws["two cycles"] = 1.0
            path += [path[0], path[0][::-1]]
    depth = np.concatenate(path)
    jitter = np.zeros(len(depth))
    if {"hold", "two cycles"} & set(flaws):  # else each repeats exactly the same depth
        jitter = 1e-4 * case.reach * rng.standard_normal(len(depth))
    duration = _spread(rng, 0.5, 5.0)
    return duration / inside * np.arange(len(depth)), depth, jitter


def _baseline(time: np.ndarray, depth: np.ndarray, rng: np.random.Generator, flaws: dict[str, float]) -> np.ndarray:
    """(n) Force without contact over the peak: rise before contact, drift in time, tilt over the depth."""
    out = np.zeros(len(time))
    away = -float(depth.min())
    if away > 0.0 and rng.uniform() < 0.3:
        flaws["rise"] = _spread(rng, 3e-3, 5e-2)
        length = away * _spread(rng, 0.05, 1.0)
        out += flaws["rise"] * np.exp(np.minimum(depth, 0.0) / length)
    elapsed = (time - time[0]) / np.ptp(time)
    if rng.uniform() < 0.3:
        flaws["drift"] = rng.choice((-1.0, 1.0)) * _spread(rng, 3e-3, 5e-2)
        out += flaws["drift"] * elapsed
    elif rng.uniform() < 0.3:
        flaws["bent drift"] = rng.choice((-1.0, 1.0)) * _spread(rng, 3e-3, 5e-2)
        out += flaws["bent drift"] * elapsed**2
    if rng.uniform() < 0.2:
        flaws["tilt"] = rng.choice((-1.0, 1.0)) * _spread(rng, 3e-3, 5e-2)
        out += flaws["tilt"] * (depth - depth.min()) / np.ptp(depth)
    return out


def _noise(kind: str, force: np.ndarray, rng: np.random.Generator, flaws: dict[str, float]) -> np.ndarray:
    """(n) Noise over the peak."""
    size, n = _spread(rng, 5e-4, 2e-2), len(force)
    if kind == "hum":  # of an amplifier that has white noise too
        line = math.sqrt(2.0) * np.sin(2.0 * math.pi * (np.arange(n) / _spread(rng, 3, 40) + rng.uniform()))
        return size * (line + _spread(rng, 0.03, 0.3) * rng.standard_normal(n))
    if kind == "heavy-tailed":
        return size * np.clip(rng.standard_t(3, n), -8.0, 8.0) / math.sqrt(3.0)
    white = rng.standard_normal(n)
    if kind in ("correlated", "gain"):
        colour = white.copy()
        for k in range(1, n):
            colour[k] = 0.9 * colour[k - 1] + math.sqrt(0.19) * white[k]
        return size * (colour if kind == "correlated" else colour * force + 0.05 * rng.standard_normal(n))
    return size * white
