"""Kinematics of the Novint Falcon: three legs at 120 degrees that translate a grip without rotating it.

Leg i is at the angle phi_i around the device's z axis (z points to the user). In the frame of the leg

    u =  cos(phi) x + sin(phi) y - r          u = a cos(t1) - c + L cos(t2)
    v = -sin(phi) x + cos(phi) y - s + f      v = b cos(t3)
    w =  z                                    w = a sin(t1) + L sin(t2)         L = d + e + b sin(t3)

with t1 the driven angle, t2 the angle of the parallelogram and t3 its sideways tilt. The lengths and the encoder are
those of the open driver libnifalcon (Machulis, Barrow, Ouellet 2007-2019); the geometry is Stamper's.

R. E. Stamper, "A three degree of freedom parallel manipulator with only translational degrees of freedom",
PhD thesis, University of Maryland, 1997.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from palpate.compiler.dot import cross, dot
from palpate.compiler.kernel import kernel

HOME = (0.0, 0.0, 0.11)
TOLERANCE = 1e-9  # [rad] forward kinematics stop here
LONGEST_STEP = 0.020  # [m] largest Newton step
ITERATIONS = 40

Three = tuple[float, float, float]


class Geometry(NamedTuple):
    """Constants of the kernels, see `FalconGeometry`."""

    a: float
    b: float
    c: float
    length: float  # d + e
    offset: float  # f - s
    r: float
    cos_phi: Three
    sin_phi: Three
    zero: float
    encoder_count: float
    limit: float


@dataclass(frozen=True)
class FalconGeometry:
    """Lengths [m], leg angles [rad], encoder and motor limit of the device; equations at the top of this file.

    zero   [rad]  driven angle at zero encoder counts
    count  [rad]  driven angle of one count: 4 x 320 counts per motor turn, drum of 14.25 mm on a sector of 110 mm
    limit  [N m]  largest torque on an arm: the largest motor command, 4096, at 10^4 per N m
    """

    a: float = 0.060
    b: float = 0.1025
    c: float = 0.01443
    d: float = 0.01125
    e: float = 0.01125
    f: float = -0.025
    r: float = 0.0400
    s: float = -0.02309
    phi: Three = (math.radians(105.0), math.radians(-15.0), math.radians(-135.0))
    zero: float = math.radians(35.0)
    count: float = 2.0 * math.pi / 1280.0 * 0.01425 / 0.110
    limit: float = 0.4096

    @cached_property
    def geometry(self) -> Geometry:
        """The constants for the kernels."""
        first, second, third = self.phi
        return Geometry(
            self.a, self.b, self.c, self.d + self.e, self.f - self.s, self.r,
            (math.cos(first), math.cos(second), math.cos(third)), (math.sin(first), math.sin(second), math.sin(third)),
            self.zero, self.count, self.limit,
        )  # fmt: skip


FALCON = FalconGeometry()


@kernel(inline=True)
def directions(geometry, i, x, y, z):
    """(reachable, (cos, sin) of t1, of t2 and of t3) of leg i at a point [m]; zeros if out of reach.

    cos(t3) = v/b    t1 = atan2(w, X) - acos((rho^2 + a^2 - L^2) / (2 a rho))    X = u + c, rho^2 = X^2 + w^2
    L cos(t2) = X - a cos(t1)    L sin(t2) = w - a sin(t1)
    """
    a, b, c, length0, offset, r = geometry.a, geometry.b, geometry.c, geometry.length, geometry.offset, geometry.r
    cos_phi, sin_phi = geometry.cos_phi[i], geometry.sin_phi[i]
    none = (0.0, 0.0)
    across = cos_phi * x + sin_phi * y - r + c
    cos3 = (-sin_phi * x + cos_phi * y + offset) / b
    if not abs(cos3) <= 1.0:
        return False, none, none, none
    sin3 = math.sqrt((1.0 - cos3) * (1.0 + cos3))
    length = length0 + b * sin3
    rho2 = across * across + z * z
    if not 0.0 < rho2 < 1e6:
        return False, none, none, none
    rho = math.sqrt(rho2)
    cosine = (rho2 + a * a - length * length) / (2.0 * a * rho)
    if not abs(cosine) <= 1.0:
        return False, none, none, none
    sine = math.sqrt((1.0 - cosine) * (1.0 + cosine))
    cos1, sin1 = (across * cosine + z * sine) / rho, (z * cosine - across * sine) / rho
    return True, (cos1, sin1), ((across - a * cos1) / length, (z - a * sin1) / length), (cos3, sin3)


@kernel
def leg(geometry, i, x, y, z):
    """Inverse kinematics of leg i at a point [m]: (reachable, t1, t2, t3) [rad]; zeros if out of reach."""
    ok, one, two, three = directions(geometry, i, x, y, z)
    return ok, math.atan2(one[1], one[0]), math.atan2(two[1], two[0]), math.atan2(three[1], three[0])


@kernel(inline=True)
def link(geometry, i, x, y, z):
    """(reachable, t1 [rad], the unit vector (x, y, z) along the parallelogram of leg i, its lever [m]) at a point [m].

    As a sin(t2 - t1) sin(t3) dt1 = cos(t2) sin(t3) du + cos(t3) dv + sin(t2) sin(t3) dw, row i of the Jacobian G of the
    driven angles, dt1/dt = G dx/dt, is vector / lever, with the lever a sin(t2 - t1) sin(t3); it has no bound where a
    leg is stretched or folded.
    """
    ok, (cos1, sin1), (cos2, sin2), (cos3, sin3) = directions(geometry, i, x, y, z)
    cos_phi, sin_phi = geometry.cos_phi[i], geometry.sin_phi[i]
    u, v, w = cos2 * sin3, cos3, sin2 * sin3
    lever = geometry.a * (sin2 * cos1 - cos2 * sin1) * sin3
    return ok, math.atan2(sin1, cos1), (cos_phi * u - sin_phi * v, sin_phi * u + cos_phi * v, w), lever


@kernel
def links(geometry, x, y, z):
    """The three legs at a point [m]: (reachable, angles t1 [rad], vectors [1] of legs 1, 2, 3, levers [m])."""
    ok0, t0, n0, l0 = link(geometry, 0, x, y, z)
    ok1, t1, n1, l1 = link(geometry, 1, x, y, z)
    ok2, t2, n2, l2 = link(geometry, 2, x, y, z)
    return ok0 and ok1 and ok2, (t0, t1, t2), n0, n1, n2, (l0, l1, l2)


@kernel
def reachable(geometry, x, y, z):
    """Whether all three legs reach the point (x, y, z) [m]."""
    one, two = directions(geometry, 0, x, y, z)[0], directions(geometry, 1, x, y, z)[0]
    return one and two and directions(geometry, 2, x, y, z)[0]


@kernel
def wrap(angle):
    """The same angle in [-pi, pi] [rad]."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


@kernel
def newton(geometry, t0, t1, t2, x, y, z):
    """Forward kinematics by Newton's method from a reachable point (x, y, z) [m]: (converged, x, y, z).

    The step is -N^-1 D (t1(P) - t), with the link vectors as the rows of N and the levers D; at most 20 mm, halved
    while it leads out of reach. Stops when each angle is within 1e-9 rad of t [rad]; not converged for angles that no
    position has.
    """
    for _ in range(ITERATIONS):
        _, angles, n0, n1, n2, levers = links(geometry, x, y, z)
        r0 = wrap(angles[0] - t0)
        r1 = wrap(angles[1] - t1)
        r2 = wrap(angles[2] - t2)
        done = max(abs(r0), abs(r1), abs(r2)) <= TOLERANCE
        c0, c1, c2 = cross(n1, n2), cross(n2, n0), cross(n0, n1)
        volume = dot(n0, c0)
        if not abs(volume) > 1e-6:
            return done, x, y, z
        w0, w1, w2 = -levers[0] * r0 / volume, -levers[1] * r1 / volume, -levers[2] * r2 / volume
        sx = w0 * c0[0] + w1 * c1[0] + w2 * c2[0]
        sy = w0 * c0[1] + w1 * c1[1] + w2 * c2[1]
        sz = w0 * c0[2] + w1 * c1[2] + w2 * c2[2]
        size = math.sqrt(sx * sx + sy * sy + sz * sz)
        if not size < math.inf:
            return False, x, y, z
        scale = min(1.0, LONGEST_STEP / size) if size > 0.0 else 0.0
        for _ in range(20):
            if reachable(geometry, x + scale * sx, y + scale * sy, z + scale * sz):
                break
            scale *= 0.5
        else:
            return done, x, y, z
        x, y, z = x + scale * sx, y + scale * sy, z + scale * sz
        if done:  # after this step the error is far below 1 nm, also near singular positions
            return True, x, y, z
    return False, x, y, z


@kernel
def forward_kernel(geometry, t0, t1, t2, x, y, z):
    """(converged, x, y, z [m]) of the grip at driven angles t0, t1, t2 [rad]: Newton from (x, y, z), then from HOME."""
    if reachable(geometry, x, y, z):
        ok, px, py, pz = newton(geometry, t0, t1, t2, x, y, z)
        if ok:
            return ok, px, py, pz
    return newton(geometry, t0, t1, t2, HOME[0], HOME[1], HOME[2])
