"""Passivity observer and controller of Hannaford & Ryu, and the limits of a force.

The observed energy is exact for a force that is held over each step.

B. Hannaford, J.-H. Ryu, IEEE Trans. Robotics Autom. 18 (2002) 1-10.
"""

import math

from palpate.compiler.kernel import kernel


@kernel
def absorbed_energy(energy, fx, fy, fz, dx, dy, dz):
    """E - F . dx [J]: energy absorbed by the display after a displacement dx [m] under the force F [N] on the hand."""
    return energy - (fx * dx + fy * dy + fz * dz)


@kernel
def dissipation(energy, dt, speed2, mass):
    """Damping [N s/m] that dissipates the generated energy within a step, alpha = min(-E / (T |v|^2), m / T).

    energy  [J]       E, observed; no damping unless negative
    dt      [s]       T, the coming step; no damping unless positive
    speed2  [m2/s2]   |v|^2; no damping at rest
    mass    [kg]      m, of the device: more damping than m/T would reverse its motion
    """
    if not (energy < 0.0 and dt > 0.0 and speed2 > 0.0):
        return 0.0
    return min(-energy / (dt * speed2), mass / dt) if dt * speed2 > 0.0 else mass / dt


@kernel
def clamp(fx, fy, fz, limit):
    """The force, scaled to the limit [N] in its direction if it is larger; zero if it is not finite."""
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
    """The force limited to a change of `reach` [N] from the previous force p, along f - p."""
    dx, dy, dz = clamp(fx - px, fy - py, fz - pz, reach)
    return px + dx, py + dy, pz + dz
