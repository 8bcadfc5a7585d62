"""The place between two steps of an encoder where a finger rests.

A reading at rest jumps to and fro between two neighbouring steps, and what differences it (the damping of a contact)
makes a great speed of each jump. So a reading that has stayed within two neighbouring steps for `REST` gives way to its
mean since it came there. From the first reading outside on each change of the reading counts at once, without delay.
How far the mean was from that reading, at most two steps, fades out over `BLEND`: as a jump it would be a great speed,
too. A reading further away, as after an outage, is a motion: it counts at once, but for these two steps.

Without it a stiff contact has no place to rest: N. Diolaiti, G. Niemeyer, F. Barbagli, J. K. Salisbury, "Stability
of haptic rendering: discretization, quantization, time delay, and Coulomb effects", IEEE Trans. Robotics
22 (2006) 256-268.
"""

import math

import numpy as np

from palpate.physics.kernel import kernel

REST = 0.05  # [s]
BLEND = 0.01  # [s] from the reading to the mean, and back
FURTHEST = 2.0  # [steps] by which what is told may differ from the reading
LOW, HIGH, HELD, SUM, TOLD, AWAY = range(6)


@kernel
def begin(cell, x, y, z):
    """Forget what was."""
    for i, reading in enumerate((x, y, z)):
        cell[LOW, i] = cell[HIGH, i] = cell[TOLD, i] = reading
        cell[HELD, i] = cell[SUM, i] = cell[AWAY, i] = 0.0


@kernel
def settle(cell, x, y, z, step, dt):
    """The place (3) after a reading (x, y, z), in its unit.

    cell  (6,3)  the range of the readings since they came here, the time [s] since, the integral over it of the
                 reading above the lowest, the place told last, and what of its distance fades out; changed in place
    step         of the reading, above 0
    dt    [s]    since the last reading, above 0
    """
    for i, reading in enumerate((x, y, z)):
        rest(cell, i, reading, step, dt)
    return cell[TOLD, 0], cell[TOLD, 1], cell[TOLD, 2]


@kernel
def rest(cell, i, reading, step, dt):
    """One of the three."""
    if reading < cell[LOW, i]:
        cell[SUM, i] += (cell[LOW, i] - reading) * cell[HELD, i]
        cell[LOW, i] = reading
    cell[HIGH, i] = max(cell[HIGH, i], reading)
    cell[AWAY, i] *= math.exp(-dt / BLEND)
    if not cell[HIGH, i] - cell[LOW, i] < 1.5 * step:
        away = cell[AWAY, i] + _share(cell[HELD, i]) * (cell[TOLD, i] - cell[AWAY, i] - reading)
        cell[AWAY, i] = min(max(away, -FURTHEST * step), FURTHEST * step)
        cell[LOW, i] = cell[HIGH, i] = reading
        cell[HELD, i] = cell[SUM, i] = 0.0
    else:
        cell[HELD, i] += dt
        cell[SUM, i] += (reading - cell[LOW, i]) * dt
        mean = cell[SUM, i] / cell[HELD, i] + cell[LOW, i]
        reading += _share(cell[HELD, i]) * (mean - reading)
    cell[TOLD, i] = reading + cell[AWAY, i]


@kernel
def _share(held):
    """Of the mean in what is told, after the readings have stayed for this time [s]."""
    return min(max((held - REST) / BLEND, 0.0), 1.0)


def buffers() -> np.ndarray:
    """Fresh state (6,3) of `settle`."""
    return np.zeros((6, 3))
