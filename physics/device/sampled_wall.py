"""How stiff a sampled wall may be: the device damping that keeps it passive.

J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997) 37-47.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize_scalar


def wall_response(
    stiffness: float, damping: float, period: float, delay: int = 0, order: int = 1
) -> Callable[[np.ndarray], np.ndarray]:
    """Frequency response [N/m] of a sampled wall, force over position, as a function of frequency [rad/s] (...).

        H = z^-d (K + B (1 - z^-N) / (N T))      z = exp(j w T)

    delay  [1]  d, whole samples between the motion and the force
    order  [1]  N, differences in the mean that the damping acts on
    """

    def response(omega: np.ndarray) -> np.ndarray:
        back = np.exp(-1j * np.asarray(omega) * period)
        return back**delay * (stiffness + damping * (1.0 - back**order) / (order * period))

    return response


def required_damping(response: Callable[[np.ndarray], np.ndarray], period: float, points: int = 4096) -> float:
    """Device damping [N s/m] above which a sampled wall of any linear law is passive,

        b > max over 0 < w <= pi/T of (T/2) Re[(1 - exp(-jwT)) H(w)] / (1 - cos(wT))

    The fraction is written as Re[j exp(-jwT/2) H] / sin(wT/2), which keeps its digits at low frequency.

    response  [N/m]  H as a function of frequency [rad/s] (...), `wall_response` for instance
    period    [s]    T
    points    [1]    of the first search; the best of them is refined
    """

    def need(phase: np.ndarray) -> np.ndarray:  # phase = w T / 2, in (0, pi/2]
        return period / 2.0 * np.real(1j * np.exp(-1j * phase) * response(2.0 * phase / period)) / np.sin(phase)

    phases = np.linspace(0.0, np.pi / 2.0, points + 1)
    phases[0] = 1e-6
    damping = need(phases)
    best = int(np.argmax(damping))
    low, high = phases[max(best - 1, 0)], phases[min(best + 1, points)]
    fine = minimize_scalar(lambda p: -need(p), bounds=(low, high), method="bounded", options={"xatol": 1e-12})
    return float(max(damping[best], -fine.fun))
