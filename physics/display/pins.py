"""Actuators of a pin display: the grid, what a limited stroke can show, how fast pins move, how finely they stop."""

import math
from typing import NamedTuple

import numpy as np

from palpate.physics.kernel import kernel


def pin_grid(rows: int, columns: int, pitch: float) -> np.ndarray:
    """Positions [m] (rows,columns,2) of the pins in the plane of the display, centred on the origin.

    Component 0 grows along a row (with the column index), component 1 down a column (with the row index).

    pitch  [m]  distance of neighbours
    """
    y = (np.arange(rows) - 0.5 * (rows - 1)) * pitch
    x = (np.arange(columns) - 0.5 * (columns - 1)) * pitch
    return np.stack(np.meshgrid(x, y), axis=-1)


@kernel
def fit_stroke(heights: np.ndarray, stroke: float, out: np.ndarray) -> float:
    """Bring pins within their stroke; the offset c [m] that the linear actuator takes over from them. Kernel.

        out_i = clip(h_i - c, 0, stroke),      mean(out) + c = mean(h)

    The second line holds exactly, and makes out + c the least-squares nearest surface to h. Where many c do the one of
    least size is taken. heights [m] (n) wanted, stroke [m] > 0, out [m] (n) receives the heights that can be had.
    """
    low, high = heights[0], heights[0]
    for h in heights:
        low, high = min(low, h), max(high, h)
    if high - low <= stroke:
        offset = min(max(0.0, high - stroke), low)
        for i in range(heights.size):
            out[i] = min(max(heights[i] - offset, 0.0), stroke)
        return offset
    # The excess sum(h - c - clip(h - c)) falls from >= 0 at c = low to <= 0 at c = high - stroke.
    lower, upper = low, high - stroke
    for _ in range(200):
        offset = 0.5 * (lower + upper)
        if offset <= lower or offset >= upper:
            break
        excess = 0.0
        for h in heights:
            excess += max(h - offset - stroke, 0.0) + min(h - offset, 0.0)
        if excess > 0.0:
            lower = offset
        else:
            upper = offset
    for i in range(heights.size):
        out[i] = min(max(heights[i] - lower, 0.0), stroke)
    return lower


@kernel
def approach_target(value: float, target: float, dt: float, rate: float, rise: float, fall: float) -> float:
    """Position [m] of an actuator after dt [s]: a first-order lag whose speed is limited, exact for a constant target.

        dx/dt = clip((target - x)/tau, -rate, rate),      tau = rise while x < target, fall while x > target

    Two steps of dt/2 give the same as one of dt, and it never overshoots. Nothing moves for dt <= 0. Kernel.

    value, target  [m];   rate [m/s] > 0, inf for no limit
    rise, fall     [s]    time constants, 0 for none (shape memory wire: heating, cooling)
    """
    if not dt > 0.0:
        return value
    gap = target - value
    tau = rise if gap > 0.0 else fall
    distance = abs(gap)
    near = rate * tau if tau > 0.0 else 0.0
    if distance > near:
        running = (distance - near) / rate
        if dt < running:
            return value + math.copysign(rate * dt, gap)
        distance = near
        dt -= running
    distance = distance * math.exp(-dt / tau) if tau > 0.0 else 0.0
    return target - math.copysign(distance, gap)


@kernel
def quantise(value: float, step: float, stroke: float) -> float:
    """The nearest whole multiple of `step` [m] within [0, stroke]; the value itself where step is 0. Kernel."""
    if step <= 0.0:
        return value
    return min(np.rint(value / step), math.floor(stroke / step * (1.0 + 1e-12))) * step


class Drives(NamedTuple):
    """What moves a display.

    stroke, travel       [m]    of a pin, of the linear actuator
    rate, actuator_rate  [m/s]  greatest speed of each
    rise, fall           [s]    time constants of the pins
    """

    stroke: float
    travel: float
    rate: float
    actuator_rate: float
    rise: float
    fall: float
    step: float  # [m] resolution of the pins, 0 for none


@kernel
def drive(
    pins: np.ndarray, wanted: np.ndarray, actuator: float, approach: float, dt: float, by: Drives, shown: np.ndarray
):
    """One step of the whole display; the new (actuator position [m], whether a stroke limits the surface). Kernel.

    pins      [m]  (n)  actuator state of each pin, updated in place
    wanted    [m]  (n)  fingerpad deformation to be shown
    actuator  [m]  ()   position of the linear actuator, positive away from the finger
    approach  [m]  ()   rigid-body motion to be shown
    shown     [m]  (n)  receives the pin heights after quantisation; used as scratch
    """
    offset = fit_stroke(wanted, by.stroke, shown)
    limited = False
    for i in range(pins.size):
        limited = limited or abs(shown[i] + offset - wanted[i]) > 1e-12
        pins[i] = approach_target(pins[i], shown[i], dt, by.rate, by.rise, by.fall)
        shown[i] = quantise(pins[i], by.step, by.stroke)
    target = min(max(approach - offset, 0.0), by.travel)
    limited = limited or target != approach - offset
    return approach_target(actuator, target, dt, by.actuator_rate, 0.0, 0.0), limited
