"""Largest stiffness of a sampled virtual wall for passivity and for stability, by exact linear theory.

The device is a mass with viscous drag, m v' = F - b v, under a force held over each step T. The wall responds `delay`
samples late with F = -K x - B (x_k - x_{k-N})/(N T) and is two-sided. The loop is linear, and its poles determine
stability.

Stability is weaker than passivity: the passive bound (J. E. Colgate, G. G. Schenkel, J. Robotic Systems 14 (1997)
37-47) is valid for every passive hand, the stable one for the device alone. T. Hulin, A. Albu-Schäffer, G. Hirzinger,
IEEE Trans. Control Syst. Technol. 22 (2014) 1297-1309, plot both in one plane.
"""

import math

import numpy as np
from scipy.optimize import minimize_scalar

from palpate.compiler.kernel import kernel

MOST = 1e9
"""[N/m] A wall that is stable up to this stiffness counts as always stable."""
POINTS = 1024  # Frequencies of the first search for the passive bound; the best of them is refined


@kernel
def hold_step(mass, drag, period):
    """Coefficients (a, p, c, q) of the exact step T [s] of a mass m [kg] with drag b > 0 [N s/m] under a held force F,

        x+ = x + a v + c F     v+ = p v + q F

    a = (m/b)(1 - p) [s], p = e^{-bT/m} [1], c = (T - a)/b [m/N], q = (1 - p)/b [m/(N s)]."""
    ratio = drag * period / mass
    rest = -math.expm1(-ratio)
    a = mass / drag * rest
    # T - a cancels for little drag; its series is T (r/2 - r²/6 + r³/24).
    short = ratio / 2 * (1 - ratio / 3 * (1 - ratio / 4)) if ratio < 1e-3 else 1.0 - rest / ratio
    return a, 1.0 - rest, period * short / drag, rest / drag


def poles(
    stiffness: float, damping: float, mass: float, drag: float, period: float, delay: int = 0, order: int = 1
) -> np.ndarray:
    """Eigenvalues [1] (delay + order + 2) of the loop over one sample; stable where all lie within the unit circle.

    stiffness  [N/m]    K of the wall      damping  [N s/m]  B of the wall, on the mean of `order` differences
    mass, drag [kg], [N s/m] > 0 of the device;  period [s] T;  delay [1] whole samples
    """
    a, p, c, q = hold_step(mass, drag, period)
    back = delay + order  # past positions in the state, in addition to x and v
    loop = np.zeros((2 + back, 2 + back))
    answer = np.zeros(2 + back)  # present force as a function of x, v, x_-1, x_-2 ...
    places = [0, *range(2, 2 + back)]
    slope = damping / (order * period)
    answer[places[delay]] -= stiffness + slope
    answer[places[delay + order]] += slope
    loop[0, :2], loop[1, 1] = (1.0, a), p
    loop[0] += c * answer
    loop[1] += q * answer
    loop[2, 0] = 1.0
    for i in range(3, 2 + back):
        loop[i, i - 1] = 1.0
    return np.asarray(np.linalg.eigvals(loop))


def stable_stiffness(damping: float, mass: float, drag: float, period: float, delay: int = 0, order: int = 1) -> float:
    """The stiffness K [N/m] at which the loop leaves the unit circle; arguments as of `poles`.

    0 if it is unstable for the softest wall, `MOST` if it is stable for the stiffest. The lowest crossing is bracketed
    in steps of 1/8 octave, then bisected to a relative error of 1e-9.
    """

    def outside(k: float) -> bool:
        return bool(np.abs(poles(k, damping, mass, drag, period, delay, order)).max() > 1.0 + 1e-12)

    low = 1e-3 * drag / period
    if outside(low):
        return 0.0
    high = low
    while not outside(high):
        low, high = high, high * 2**0.125
        if high > MOST:
            return MOST
    while high - low > 1e-9 * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if outside(middle) else (middle, high)
    return low


def passive_stiffness(damping: float, drag: float, period: float, delay: int = 0, order: int = 1) -> float:
    """The greatest K [N/m] of a passive wall; 0 if the damping of the wall alone is too much for the drag b [N s/m] of
    the device. Colgate & Schenkel 1997: the wall H = z^-d (K + B (1 - z^-N)/(N T)), z = exp(j w T), is passive if

        b >= (T/2) Re[(1 - 1/z) H]/(1 - cos wT) = Re[L (K + B (1 - z^-N)/(N T))]   for 0 < w <= pi/T
        L = (T/2) j exp(-j w T/2) z^-d/sin(w T/2),   a form without cancellation at low frequency

    so K is the least (b - B Re[L (1 - z^-N)]/(N T))/Re[L] where Re[L] > 0.
    """

    def sides(phase: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Re[L], and b less the part of B, at phase = w T/2 in (0, pi/2]."""
        back = np.exp(-2j * phase)
        lag = period / 2.0 * 1j * np.exp(-1j * phase) * back**delay / np.sin(phase)
        return lag.real, drag - damping * (lag * (1.0 - back**order)).real / (order * period)

    def most(phase: np.ndarray) -> np.ndarray:
        spring, left = sides(phase)
        return np.where(spring > 0.0, left / np.where(spring > 0.0, spring, 1.0), np.inf)

    phases = np.linspace(0.0, np.pi / 2.0, POINTS + 1)
    phases[0] = 1e-6
    if (sides(phases)[1] < 0.0).any():
        return 0.0
    stiffness = most(phases)
    best = int(np.argmin(stiffness))
    near = phases[max(best - 1, 0)], phases[min(best + 1, POINTS)]
    return float(
        min(stiffness[best], minimize_scalar(most, bounds=near, method="bounded", options={"xatol": 1e-12}).fun)
    )


def quantised_stiffness(drag: float, coulomb: float, period: float, resolution: float) -> float:
    """K [N/m] up to which a wall seen through an encoder is passive, K <= min(2 b/T, 2 f_c/step): necessary and
    sufficient for a spring without delay (J. J. Abbott, A. M. Okamura, IEEE Trans. Robotics 21, 2005, 952-964).

    coulomb     [N]  dry friction f_c of the device      resolution  [m]  step of its position; 0 means exact
    """
    viscous = 2.0 * drag / period
    return viscous if resolution == 0.0 else min(viscous, 2.0 * coulomb / resolution)
