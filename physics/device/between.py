"""The place between two steps of an encoder where a finger rests.

A reading at rest jumps to and fro between two neighbouring steps, and what differences it (the damping of a contact)
makes a great speed of each jump. So a reading that has stayed within two neighbouring steps for `REST` gives way to its
mean since it came there. The first reading outside counts at once, as it is: what moves has no delay.

Without it a stiff contact has no place to rest: N. Diolaiti, G. Niemeyer, F. Barbagli, J. K. Salisbury, "Stability
of haptic rendering: discretization, quantization, time delay, and Coulomb effects", IEEE Trans. Robotics
22 (2006) 256-268.
"""

from __future__ import annotations

import numba
import numpy as np

REST = 0.05  # [s]
BLEND = 0.01  # [s] from the reading to the mean
LOW, HIGH, HELD, SUM = range(4)


@numba.njit(cache=True)
def begin(cell, x, y, z):
    """Forget what was."""
    cell[LOW, 0], cell[LOW, 1], cell[LOW, 2] = x, y, z
    cell[HIGH, :] = cell[LOW, :]
    cell[HELD:, :] = 0.0


@numba.njit(cache=True)
def settle(cell, x, y, z, step, dt):
    """The place (3) after a reading (x, y, z), in its unit.

    cell  (4,3)  the range of the readings since they came here, the time [s] since, and the integral over it of
                 the reading above the lowest; changed in place
    step         of the reading, above 0
    dt    [s]    since the last reading, above 0
    """
    a, b, c = rest(cell, 0, x, step, dt), rest(cell, 1, y, step, dt), rest(cell, 2, z, step, dt)
    return a, b, c


@numba.njit(cache=True)
def rest(cell, i, reading, step, dt):
    """One of the three."""
    if reading < cell[LOW, i]:
        cell[SUM, i] += (cell[LOW, i] - reading) * cell[HELD, i]
        cell[LOW, i] = reading
    cell[HIGH, i] = max(cell[HIGH, i], reading)
    if not cell[HIGH, i] - cell[LOW, i] < 1.5 * step:
        cell[LOW, i] = cell[HIGH, i] = reading
        cell[HELD, i] = cell[SUM, i] = 0.0
        return reading
    cell[HELD, i] += dt
    cell[SUM, i] += (reading - cell[LOW, i]) * dt
    share = min(max((cell[HELD, i] - REST) / BLEND, 0.0), 1.0)
    away = cell[SUM, i] / cell[HELD, i] + cell[LOW, i] - reading
    return reading + share * away


def buffers() -> np.ndarray:
    """Fresh state (4,3) of `settle`."""
    return np.zeros((4, 3))
