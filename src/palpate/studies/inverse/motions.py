"""Which touch determines the parameters best: expected intervals for a family of motions, from derivatives.

The Fisher matrix of a motion is J'J/s², with the derivatives J of the fields by the parameters there, and the noise s²
of each field, times its correlation time. An expected interval is ± 1.96 sqrt(diag (J'J/s²)^-1). D-optimal is the
motion with the largest determinant, so the smallest joint interval; A-optimal the one with the smallest mean square
of the relative intervals.

A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum Experimental Designs, with SAS (2007), ch. 10.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate.models.fit.tissue.residuals import inflation
from palpate.physics.scratch import ScratchFolder
from palpate.studies.inverse.fit import RunFit
from palpate.studies.inverse.measured import Measured, driven
from palpate.studies.inverse.problem import RunProblem

RECORDED = "as recorded"
STROKE, SIDEWAYS = 0.01, 0.2  # [m], [s] of the added stroke, there and back
HELD = 1.0  # [s]
Motion = np.ndarray
"""(n, 4) rows of time [s] and position [m]."""


@dataclass
class Planned:
    """How well a motion would determine the parameters.

    relative  (parameters) half of the expected 95 % interval over the value, or in scales
    d, a      [1] logarithm of the determinant of the Fisher matrix; RMS of `relative`
    """

    name: str
    duration: float
    relative: np.ndarray
    d: float
    a: float


def family(place: np.ndarray, rate: float) -> dict[str, Motion]:
    """Motions near a recorded one with positions (n, 3) [m]."""
    time = np.arange(len(place)) / rate
    far = place - place[0]
    deep = int(np.argmax(np.linalg.norm(far - far[0], axis=1)))
    way = far[deep] / max(float(np.linalg.norm(far[deep])), 1e-9)
    side = np.cross(way, [0.0, 1.0, 0.0] if abs(way[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    deeper = place[0] + 1.1 * far

    def at(times: np.ndarray, places: np.ndarray) -> Motion:
        return np.column_stack([times, places])

    def inserted(moves: Sequence[tuple[float, np.ndarray]]) -> Motion:
        """The motion with moves to offsets [m] (3) at its deepest point, each in some time [s]."""
        rows, now = [at(time[: deep + 1], place[: deep + 1])], float(time[deep])
        for took, offset in moves:
            now += took
            rows.append(np.array([[now, *(place[deep] + offset)]]))
        rows.append(at(time[deep + 1 :] - time[deep] + now, place[deep + 1 :]))
        return np.concatenate(rows)

    stroke = [(SIDEWAYS, STROKE * side), (SIDEWAYS, -STROKE * side), (SIDEWAYS, 0.0 * side)]
    return {
        RECORDED: at(time, place),
        "twice as fast": at(time / 2.0, place),
        "half as fast": at(time * 2.0, place),
        "10 % farther": at(time, deeper),
        f"with a stroke of {1e3 * STROKE:g} mm": inserted(stroke),
        f"held for {HELD:g} s": inserted([(HELD, 0.0 * side)]),
    }


def plan_touches(
    fit: RunFit, measured: Measured, motions: Mapping[str, Mapping[str, Motion]] | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> list[Planned]:  # fmt: skip
    """Expected intervals of the fitted parameters for motions, D-optimal first.

    motions  by name, the motion of each finger; None: the `family` of the recorded one
    """
    families = {finger: family(place, measured.rate) for finger, place in measured.motion.items()}
    names = list(next(iter(families.values())))
    motions = motions or {name: {finger: each[name] for finger, each in families.items()} for name in names}
    folder, noise = ScratchFolder("plan-touch"), _noise(fit, measured)
    found = []
    for number, (name, moves) in enumerate(motions.items()):
        files = {}
        for finger, rows in moves.items():
            files[finger] = (Path(folder.name) / f"{number}-{finger}.csv", finger)
            np.savetxt(files[finger][0], rows, delimiter=",", header="t,x,y,z", comments="", fmt="%.12g")
        length = max(float(rows[-1, 0]) for rows in moves.values())
        found.append(_planned(name, length, fit, measured, files, noise))
        report((number + 1) / len(motions))
    return sorted(found, key=lambda each: -each.d)


def _noise(fit: RunFit, measured: Measured) -> list[float]:
    """Noise of each field times the root of its correlation time, of the recorded motion."""
    found = []
    for path in measured.fields:
        place = list(fit.rms).index(f"{measured.name} {path}")
        r = fit.estimate.residuals[place]
        peak = max(float(np.abs(values).max()) for values in measured.values)
        tau = inflation([r], len(fit.estimate.at))
        found.append(max(fit.rms[f"{measured.name} {path}"] * math.sqrt(tau), 1e-6 * peak))
    return found


def _planned(
    name: str, length: float, fit: RunFit, measured: Measured, files: Mapping[str, tuple[Path, str]],
    noise: Sequence[float],
) -> Planned:  # fmt: skip
    """How well a motion would determine the parameters."""
    ticks = max(2, round(length * measured.rate) + 1)
    rows = np.arange(0, ticks, max(1, round(measured.rows[1] - measured.rows[0])))
    launch = driven(measured.base, files, measured.fields).but(duration=ticks / measured.rate)
    empty = [np.ones((len(rows), values.shape[1])) for values in measured.values]
    problem = RunProblem([replace(measured, launch=launch, rows=rows, ticks=ticks, values=empty)], fit.parameters)
    try:
        x = np.array([p.to_search(fit.estimate.values[each]) for p, each in zip(
            problem.parameters, _names(fit, measured, problem), strict=True)])  # fmt: skip
        here = problem.law_forces(x)
        scales = np.concatenate([np.full(len(f), 1.0 / s) for f, s in zip(here, noise, strict=True)])
        slopes = problem.law_slopes(x, here, np.ones(len(x), bool)) * scales[:, None] * problem._scales()
    finally:
        problem.close()
    fisher = slopes.T @ slopes
    sizes = np.linalg.eigvalsh(fisher)
    spread = np.sqrt(np.diag(np.linalg.inv(fisher + 1e-9 * np.eye(len(x)))))
    relative = 1.96 * spread
    return Planned(name, length, relative, float(np.log(np.maximum(sizes, 1e-12)).sum()),
                   float(np.sqrt(np.mean(relative**2))))  # fmt: skip


def _names(fit: RunFit, measured: Measured, problem: RunProblem) -> list[str]:
    """The names of the unknowns of a recording in the estimate: those of this recording alone have its name."""
    return [
        each if each in fit.estimate.values else f"{each}, {measured.name}" for each in problem.names
    ]  # fmt: skip
