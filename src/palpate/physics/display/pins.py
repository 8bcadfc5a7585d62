"""Actuators of a pin display: the grid of pins, limited stroke, dynamics and resolution."""

import math
from typing import NamedTuple

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array


def pin_grid(rows: int, columns: int, pitch: float) -> np.ndarray:
    """Positions [m] (rows,columns,2) of the pins in the plane of the display, centred on the origin, with a pitch [m].
    Component 0 increases with the column index, component 1 with the row index."""
    y = (np.arange(rows) - 0.5 * (rows - 1)) * pitch
    x = (np.arange(columns) - 0.5 * (columns - 1)) * pitch
    return np.stack(np.meshgrid(x, y), axis=-1)


@kernel
def fit_stroke(heights: Array, stroke: float, out: Array) -> float:
    """Limit the pins to their stroke; returns the offset c [m] that the linear actuator adds.

        out_i = clip(h_i - c, 0, stroke),      mean(out) + c = mean(h)

    The second equation is exact and makes out + c the least-squares approximation of h; of several solutions c the
    smallest is used. heights [m] (n) targets h, stroke [m] > 0, out [m] (n) is filled.
    """
    low, high = heights[0], heights[0]
    for h in heights:
        low, high = min(low, h), max(high, h)
    if high - low <= stroke:
        offset = min(max(0.0, high - stroke), low)
        for i in range(heights.size):
            out[i] = min(max(heights[i] - offset, 0.0), stroke)
        return offset
    # bisection: sum(h - c - clip(h - c)) decreases from >= 0 at c = low to <= 0 at c = high - stroke
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
    """Position [m] of an actuator after dt [s]: a first-order lag with limited speed, exact for a constant target.

        dx/dt = clip((target - x)/tau, -rate, rate),      tau = rise while x < target, fall while x > target

    Two steps of dt/2 equal one of dt, without overshoot. No motion for dt <= 0.

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
    """The nearest integer multiple of `step` [m] within [0, stroke]; the value itself if step is 0."""
    if step <= 0.0:
        return value
    return min(np.rint(value / step), math.floor(stroke / step * (1.0 + 1e-12))) * step


class Drives(NamedTuple):
    """Actuators of a display.

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
def drive(pins: Array, wanted: Array, actuator: float, approach: float, dt: float, by: Drives, shown: Array):
    """One step of the whole display. Returns the new actuator position [m], and whether a stroke limits the surface.

    pins      [m]  (n)  state of each pin, updated in place
    wanted    [m]  (n)  target deformation of the fingerpad
    actuator  [m]  ()   position of the linear actuator, positive away from the finger
    approach  [m]  ()   target rigid-body motion
    shown     [m]  (n)  receives the pin heights after quantisation
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
