"""Forces and torques of the Falcon by virtual work, bounded at singular poses and by the motors' limit.

With N the unit vectors along the three parallelograms as rows and D their levers (`falcon.link`), G = D^-1 N, so

    torque = G^-T F = D N^-T F        F = G^T torque = N^T D^-1 torque

The first is singular where the three vectors are coplanar, the second where a leg is stretched or folded.
"""

import math

from palpate.compiler.dot import cross, dot
from palpate.compiler.kernel import kernel
from palpate.physics.device.falcon import links

FLAT = 0.02  # [1] volume spanned by the link vectors below which the inverse is damped
DAMPING = 0.05  # [1] largest damping of that inverse
SHORT = 1e-3  # [m] lever below which its inverse is limited


@kernel
def saturate(t0, t1, t2, limit):
    """The torques [N m] of the arms, scaled by a common factor so that none exceeds the limit [N m] > 0; zero if one is
    not finite."""
    largest = max(abs(t0), abs(t1), abs(t2))
    if not (abs(t0) < math.inf and abs(t1) < math.inf and abs(t2) < math.inf):
        return 0.0, 0.0, 0.0
    if largest <= limit:
        return t0, t1, t2
    # Divide first: for a huge torque limit / largest may underflow; so the largest becomes exactly the limit.
    return limit * (t0 / largest), limit * (t1 / largest), limit * (t2 / largest)


@kernel
def torque_kernel(geometry, fx, fy, fz, x, y, z):
    """(reachable, torques [N m]) = G^-T F of the arms for a force [N] on the hand at a point [m]; zero if out of reach.

    Near a singular pose the inverse is damped (least squares), so the torque stays bounded. A torque beyond the motors'
    limit is scaled as a whole vector: the direction of the force is kept. Y. Nakamura, H. Hanafusa, J. Dyn. Syst. Meas.
    Control 108 (1986) 163-171, for the damped inverse.
    """
    ok, _, n0, n1, n2, levers = links(geometry, x, y, z)
    if not ok:
        return False, 0.0, 0.0, 0.0
    force = (fx, fy, fz)
    c0, c1, c2 = cross(n1, n2), cross(n2, n0), cross(n0, n1)
    volume = dot(n0, c0)
    if abs(volume) >= FLAT:
        t0, t1, t2 = dot(c0, force) / volume, dot(c1, force) / volume, dot(c2, force) / volume
    else:
        t0, t1, t2 = solve_damped(n0, n1, n2, force, DAMPING * (1.0 - abs(volume) / FLAT))
    return (True, *saturate(levers[0] * t0, levers[1] * t1, levers[2] * t2, geometry.limit))


@kernel
def solve_damped(n0, n1, n2, force, damping):
    """Damped least squares for N^T t = force: (N N^T + damping^2) t = N force, by Cramer's rule."""
    diagonal = 1.0 + damping * damping
    g01, g02, g12 = dot(n0, n1), dot(n0, n2), dot(n1, n2)
    r0, r1, r2 = dot(n0, force), dot(n1, force), dot(n2, force)
    square = diagonal * diagonal
    m00, m11, m22 = square - g12 * g12, square - g02 * g02, square - g01 * g01
    m01, m02, m12 = g02 * g12 - g01 * diagonal, g01 * g12 - g02 * diagonal, g01 * g02 - g12 * diagonal
    det = diagonal * m00 + g01 * m01 + g02 * m02
    if det <= 0.0:  # parallel vectors without damping
        return 0.0, 0.0, 0.0
    return (
        (m00 * r0 + m01 * r1 + m02 * r2) / det,
        (m01 * r0 + m11 * r1 + m12 * r2) / det,
        (m02 * r0 + m12 * r1 + m22 * r2) / det,
    )


@kernel
def force_kernel(geometry, t0, t1, t2, x, y, z):
    """(reachable, force on the hand [N]) = G^T torque for torques [N m] at a point [m]; zero if out of reach.

    Bounded where a leg is stretched or folded: its lever's inverse grows no further below 1 mm.
    """
    ok, _, n0, n1, n2, levers = links(geometry, x, y, z)
    if not ok:
        return False, 0.0, 0.0, 0.0
    w0, w1, w2 = t0 * invert_lever(levers[0]), t1 * invert_lever(levers[1]), t2 * invert_lever(levers[2])
    return (
        True,
        w0 * n0[0] + w1 * n1[0] + w2 * n2[0],
        w0 * n0[1] + w1 * n1[1] + w2 * n2[1],
        w0 * n0[2] + w1 * n1[2] + w2 * n2[2],
    )


@kernel
def invert_lever(lever):
    """1/lever [1/m]; below SHORT lever/SHORT², which falls to zero."""
    return 1.0 / lever if abs(lever) >= SHORT else lever / (SHORT * SHORT)
