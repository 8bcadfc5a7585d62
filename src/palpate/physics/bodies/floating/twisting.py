"""The moment with which a fingertip of some width resists that an organ twists under it, about the contact's normal.

A patch with the pressure p(rho) has the moment mu integral p rho dA = mu f <rho> where all of it slips, and where it
sticks the stiffness <rho²> times that of its friction. So over a step of T with the rate w about the normal

    theta += T w,    M = k theta + c w within +-mu f <rho>,    k theta within the same

with k, c = <rho²> times spring and damper of the stick. The spring part is a return mapping, so that M w T is at least
the rise of k theta²/2 for a constant f. The limits of force and moment do not depend on each other here.

R. D. Howe, M. R. Cutkosky, Int. J. Robotics Res. 15 (1996) 557-572: limit surfaces of soft fingers.
"""

import numpy as np

from palpate.compiler.kernel import kernel


def mean_radii(pressure: np.ndarray, radius: float) -> tuple[float, float]:
    """<rho> [m] and <rho²> [m²] of a patch: its pressure (n) at the middles of n rings of the radius [m]."""
    rho = radius * (np.arange(len(pressure)) + 0.5) / len(pressure)
    share = pressure * rho / (pressure * rho).sum()
    return float((share * rho).sum()), float((share * rho * rho).sum())


@kernel
def twist(theta: float, rate: float, k: float, c: float, limit: float, dt: float):
    """M [N m] and theta [rad] at the end of a step.

    theta [rad]  at its start;  rate [rad/s]  w;  k [N m/rad], c [N m s/rad];  limit [N m] mu f <rho>
    """
    theta += dt * rate
    if k * abs(theta) > limit:
        theta = limit / k if theta > 0.0 else -limit / k
    return min(max(k * theta + c * rate, -limit), limit), theta
