"""Planar five-bar linkage, the mechanism of Haply's 2diy: two driven cranks, two links to one handle.

The motors stand at (0, 0) and (d, 0). With the elbows A = l (cos q1, sin q1) and B = (d, 0) + l (cos q2, sin q2), the
handle P lies at the distance L from both, on the far side of AB. |P - A|^2 = L^2 gives (P - A) . dP = (P - A) . dA, and
the same for B, so the rows of the rates' inverse are known and

    dP = J dq    torque = J^T F

As in the maker's open library (hAPI), with the lengths of its two builds; the derivative is done anew here.
"""

import math
from typing import NamedTuple


class Pantograph(NamedTuple):
    """Lengths [m]: crank, link, distance of the motors."""

    crank: float = 0.07
    link: float = 0.09
    apart: float = 0.038


def handle(mechanism: Pantograph, q1: float, q2: float) -> tuple[float, float] | None:
    """Where the handle is [m] at crank angles [rad]; None where the links do not meet."""
    ax, ay = mechanism.crank * math.cos(q1), mechanism.crank * math.sin(q1)
    bx, by = mechanism.apart + mechanism.crank * math.cos(q2), mechanism.crank * math.sin(q2)
    hx, hy = bx - ax, by - ay
    half2 = 0.25 * (hx * hx + hy * hy)
    rise2 = mechanism.link**2 - half2
    if not (half2 > 0.0 and rise2 >= 0.0):
        return None
    scale = math.sqrt(rise2 / (4.0 * half2))
    return ax + 0.5 * hx - scale * hy, ay + 0.5 * hy + scale * hx


def cranks(mechanism: Pantograph, x: float, y: float) -> tuple[float, float] | None:
    """Crank angles [rad] at a place of the handle [m], elbows outwards; None out of reach."""
    angles = []
    for base, side in ((0.0, 1.0), (mechanism.apart, -1.0)):
        dx, r2 = x - base, (x - base) ** 2 + y * y
        cosine = (r2 + mechanism.crank**2 - mechanism.link**2) / (2.0 * mechanism.crank * math.sqrt(r2)) if r2 else 2.0
        if not abs(cosine) <= 1.0:
            return None
        # The left crank lies left of the line from its motor to the handle, the right one right of it.
        angles.append(math.atan2(y, dx) + side * math.acos(cosine))
    return angles[0], angles[1]


def jacobian(mechanism: Pantograph, q1: float, q2: float) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """J [m/rad] (2,2), rows x and y, columns q1 and q2; None where the links do not meet or lie in one line."""
    place = handle(mechanism, q1, q2)
    if place is None:
        return None
    x, y = place
    s1, c1, s2, c2 = math.sin(q1), math.cos(q1), math.sin(q2), math.cos(q2)
    l = mechanism.crank
    ux, uy = x - l * c1, y - l * s1
    vx, vy = x - mechanism.apart - l * c2, y - l * s2
    det = ux * vy - uy * vx
    if abs(det) < 1e-6:
        return None
    a, b = l * (-ux * s1 + uy * c1), l * (-vx * s2 + vy * c2)  # (P - A) . dA / dq1, (P - B) . dB / dq2
    return (a * vy / det, -b * uy / det), (-a * vx / det, b * ux / det)
