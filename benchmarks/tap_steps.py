"""Time integration of finger and tissue in fast taps: implicit Euler compared with limited second-order rates.

    python benchmarks/tap_steps.py

Fingertip and Kelvin-Voigt tissue in series, e = s1 + s, (b/m)(exp(m s1) - 1) <1 + c s1'> = K (s + tau s'), as in the
references of the accuracy bench. The rate at the end of a step is

    Euler      v = (s - s0)/T
    BDF2       v + (v - v0)/2
    limited    v + minmod(v - v0, v0 - v00)/2:  2nd order where the motion is smooth, Euler at a corner
    lagged     v + minmod(v0 - v00, v00 - v000)/2:  known before the step, so that a terminal law stays linear
    predicted  v + d/2 of palpate.physics.contact.end_rate, as in the nodes; known before the step

Each rate is nondecreasing in s, so a step has a unique solution; <x> = max(x, 0) keeps the force positive. Printed: the
force error (RMS/worst, % of peak) relative to extrapolated Euler at 128 kHz, and the least net work of random closed
motions over the work put in, which is negative if the law generates energy.
"""

import math

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.contact.end_rate import STEPS, expected_change, minmod, remember

RATES = (1000, 2000, 4000)  # [Hz]
FINE = 128000  # [Hz]
APART = -1e-4  # [m]
STIFFNESS, RETARDATION = 270.0, 0.02  # [N/m], [s] of the slab under a patch of 8 mm
FORMS = {"Euler": (0, 0), "BDF2": (1, 1), "limited": (2, 2), "lagged": (3, 3), "lagged finger, limited tissue": (3, 2),
         "predicted": (4, 4)}  # fmt: skip
PATHS = {
    "tap of 30 ms": (True, ((0.0, APART), (0.015, 4e-3), (0.03, APART), (0.1, APART))),
    "triangle of 30 ms": (False, ((0.0, APART), (0.015, 4e-3), (0.03, APART), (0.1, APART))),
    "press that stops": (False, ((0.0, APART), (0.1, 5e-3), (0.3, 5e-3))),
    "hold": (True, ((0.0, APART), (0.1, 5.5e-3), (0.4, 5.5e-3), (0.5, APART), (0.6, APART))),
}


@kernel
def end_rate(v, past, form):
    """Rate [m/s] at the end of a step with the mean rate v, after steps with mean rates past (4), the newest first."""
    if form == 0:
        return v
    if form == 1:
        return v + 0.5 * (v - past[0])
    if form == 2:
        return v + 0.5 * minmod(v - past[0], past[0] - past[1])
    if form == 3:
        return v + 0.5 * minmod(past[0] - past[1], past[1] - past[2])
    return v + 0.5 * expected_change(past)


@kernel
def fingertip(s1, rate):
    return 26.2641 / 1681.06 * math.expm1(1681.06 * s1) * max(1.0 + 8.0 * rate, 0.0) if s1 > 0.0 else 0.0


@kernel
def pressed(approach, dt, stiffness, retardation, finger_form, tissue_form):
    """Force [N] (T,) under these approaches [m] (T,)."""
    force = np.zeros(len(approach))
    of_finger, of_tissue, s, s1 = np.zeros(STEPS), np.zeros(STEPS), 0.0, 0.0
    for i in range(len(approach)):
        low, high, x, f = -1e-3, max(approach[i], 0.0) + 1e-3, 0.0, 0.0
        for _ in range(60):
            x = 0.5 * (low + high)
            f = fingertip(approach[i] - x, end_rate((approach[i] - x - s1) / dt, of_finger, finger_form))
            if f > stiffness * (x + retardation * end_rate((x - s) / dt, of_tissue, tissue_form)):
                low = x
            else:
                high = x
        y = approach[i] - x if f > 0.0 else max(min(approach[i] - x, s1), 0.0)
        remember(of_finger, (y - s1) / dt, True)
        remember(of_tissue, (x - s) / dt, True)
        force[i], s, s1 = f, x, y
    return force


def moved(smooth: bool, knots: tuple[tuple[float, float], ...], rate: float) -> np.ndarray:
    """Approach [m] at each tick, between the knots by half cosines (`smooth`) or linear."""
    at, to = np.array(knots).T
    time = np.arange(round(at[-1] * rate) + 1) / rate
    k = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 2)
    q = np.clip((time - at[k]) / (at[k + 1] - at[k]), 0.0, 1.0)
    return to[k] + (to[k + 1] - to[k]) * (0.5 - 0.5 * np.cos(np.pi * q) if smooth else q)


def error(path: str, form: str, rate: float, fine: np.ndarray) -> tuple[float, float]:
    """RMS and largest error of the force, relative to the peak of the fine solution."""
    force = pressed(moved(*PATHS[path], rate), 1.0 / rate, STIFFNESS, RETARDATION, *FORMS[form])
    off = (force - fine[:: round(FINE / rate)]) / fine.max()
    return float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())


def reference(path: str) -> np.ndarray:
    """Force [N] at `FINE`, by Richardson extrapolation from `FINE` and half of it."""
    e = moved(*PATHS[path], FINE)
    fine, coarse = (pressed(e[::n], n / FINE, STIFFNESS, RETARDATION, 0, 0) for n in (1, 2))
    time = np.arange(len(e))
    return 2.0 * fine - np.interp(time, time[::2], coarse)


def least_work(form: str, trials: int = 300) -> float:
    """Least net work over work put in, of closed motions at 1 kHz: noise, sines and square waves up to 400 Hz."""
    random, least = np.random.default_rng(3), np.inf
    for trial in range(trials):
        tick, turns, phase = np.arange(400), random.uniform(5, 400), random.uniform(0, 6)
        wave = np.sin(2 * np.pi * turns * tick / 1000 + phase)
        shape = (0.06 * np.cumsum(random.standard_normal(400)), wave, np.sign(wave))[trial % 3]
        e = np.concatenate([[APART], 2e-3 * (1.0 + shape), np.full(200, APART)])
        work = pressed(e, 1e-3, STIFFNESS, RETARDATION, *FORMS[form])[1:] * np.diff(e)
        if work.any():
            least = min(least, float(work.sum() / np.maximum(work, 0.0).sum()))
    return least


def main() -> None:
    for path in PATHS:
        fine = reference(path)
        print(f"{path}, peak {fine.max():.3f} N; at {', '.join(map(str, RATES))} Hz")
        for form in FORMS:
            off = [error(path, form, rate, fine) for rate in RATES]
            print(f"  {form:30}", "  ".join(f"{100 * a:5.2f}/{100 * b:5.2f}" for a, b in off))
    for form in FORMS:
        print(f"least net work, {form:30} {least_work(form):.3f}")


if __name__ == "__main__":
    main()
