"""Energy that a display gives out: how to see it and take it back, and the limits of a force.

The observer and controller of Hannaford & Ryu, with the energy exact for a force held over each step.

B. Hannaford, J.-H. Ryu, IEEE Trans. Robotics Autom. 18 (2002) 1-10.
"""

import math

from palpate.physics.kernel import kernel


@kernel
def absorbed(energy, fx, fy, fz, dx, dy, dz):
    """E - F . dx [J]: energy that the display has absorbed after a way dx [m] under a held force F [N] on the hand."""
    return energy - (fx * dx + fy * dy + fz * dz)


@kernel
def dissipation(energy, dt, speed2, mass):
    """Damping [N s/m] that takes an observed debt back within a step, alpha = min(-E / (T |v|^2), m / T).

    energy  [J]       observed; 0 damping when it is not negative
    dt      [s]       T, the coming step; 0 damping when it is not positive
    speed2  [m2/s2]   |v|^2, 0 damping at rest
    mass    [kg]      m, of the device: with more than m/T the damping itself would reverse its motion
    """
    if not (energy < 0.0 and dt > 0.0 and speed2 > 0.0):
        return 0.0
    return min(-energy / (dt * speed2), mass / dt) if dt * speed2 > 0.0 else mass / dt


@kernel
def clamp(fx, fy, fz, limit):
    """The force scaled to the limit [N] where it is larger; its direction is kept. Zero where it is not finite."""
    largest = max(abs(fx), abs(fy), abs(fz))
    if not (abs(fx) < math.inf and abs(fy) < math.inf and abs(fz) < math.inf):
        return 0.0, 0.0, 0.0
    if largest == 0.0:
        return fx, fy, fz
    ux, uy, uz = fx / largest, fy / largest, fz / largest  # so that the square of a huge force stays finite
    size = math.sqrt(ux * ux + uy * uy + uz * uz)
    if largest <= limit / size:
        return fx, fy, fz
    scale = limit / size
    return scale * ux, scale * uy, scale * uz


@kernel
def slew(fx, fy, fz, px, py, pz, reach):
    """The force on the straight way from the previous force p to f, at most `reach` [N] from p."""
    dx, dy, dz = clamp(fx - px, fy - py, fz - pz, reach)
    return px + dx, py + dy, pz + dz
