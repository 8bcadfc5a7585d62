"""Newton's method for the closest point of a NURBS patch, from one start.

With r = S(u,v) - p, minimise r.r / 2:

    g = (r.S_u, r.S_v),   H = [[S_u.S_u + r.S_uu, S_u.S_v + r.S_uv], [., S_v.S_v + r.S_vv]]

If H is not positive definite, the magnitudes of its eigenvalues are used. Steps are halved until r.r decreases
(Armijo). A parameter of an open direction is limited to its domain and fixed while the gradient points outwards; one of
a closed direction wraps. From a saddle point the search continues along the direction of negative curvature.

Near a pole S_u vanishes: steps are taken in polar coordinates rho = |v - v_pole|, phi = 2 pi u in the plane
(rho cos phi, rho sin phi), in which gradient and Hessian are finite and rho = 0 is no border.

L. Piegl, W. Tiller, The NURBS Book, 2nd ed., Springer 1997, sec. 6.1 (point inversion).
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record
from palpate.physics.geometry import nurbs

ZERO_DISTANCE = 1e-9  # [m] Distance below which a point is on the surface
ZERO_COSINE = 1e-9  # [1] Cosine between r and the surface below which r is normal to it
ZERO_MOVE = 1e-10  # [m] Length of a step below which the search ends
POLE_RADIUS = 1e-9  # [1] Least distance of v from a pole, where u is undefined, over the domain of v
LIMIT = 60  # iterations


@kernel
def _polar(data: Array, layout: Record, v: float):
    """+1 in the span next to a pole at the low end of v, -1 at the high end, 0 elsewhere."""
    _, _, v0, v1 = nurbs.bounds(data, layout)
    b, spans = layout.ends_v, layout.spans_v
    if layout.pole_low and v < data[b + 1] and (spans > 1 or v - v0 <= v1 - v or not layout.pole_high):
        return 1.0
    if layout.pole_high and v >= data[b + spans - 1]:
        return -1.0
    return 0.0


@kernel
def _move_parameters(data: Array, layout: Record, side: float, u: float, v: float, s1: float, s2: float):
    """The parameters after a step (du, dv), or near a pole (radial, tangential) in units of v."""
    u0, u1, v0, v1 = nurbs.bounds(data, layout)
    if side == 0.0:
        v = nurbs.wrap(v + s2, v0, v1, layout.closed_v)
        u = nurbs.wrap(u + s1, u0, u1, layout.closed_u)
    else:
        rho = (v - v0 if side > 0 else v1 - v) + s1
        u = nurbs.wrap(u + np.arctan2(s2, rho) * (u1 - u0) / (2.0 * np.pi), u0, u1, True)
        rho = np.hypot(rho, s2)
        v = min(max(v0 + rho if side > 0 else v1 - rho, v0), v1)
    keep = POLE_RADIUS * (v1 - v0)
    if layout.pole_low:
        v = max(v, v0 + keep)
    if layout.pole_high:
        v = min(v, v1 - keep)
    return u, v


@kernel
def _model(data: Array, layout: Record, side: float, v: float, d: Matrix, r0: float, r1: float, r2: float):
    """Gradient (2), Hessian (3) and metric (3) of r.r / 2 in the coordinates of `_move_parameters`."""
    su = d[1, 0] * d[1, 0] + d[1, 1] * d[1, 1] + d[1, 2] * d[1, 2]
    sv = d[2, 0] * d[2, 0] + d[2, 1] * d[2, 1] + d[2, 2] * d[2, 2]
    suv = d[1, 0] * d[2, 0] + d[1, 1] * d[2, 1] + d[1, 2] * d[2, 2]
    gu = r0 * d[1, 0] + r1 * d[1, 1] + r2 * d[1, 2]
    gv = r0 * d[2, 0] + r1 * d[2, 1] + r2 * d[2, 2]
    huu = su + r0 * d[3, 0] + r1 * d[3, 1] + r2 * d[3, 2]
    huv = suv + r0 * d[4, 0] + r1 * d[4, 1] + r2 * d[4, 2]
    hvv = sv + r0 * d[5, 0] + r1 * d[5, 1] + r2 * d[5, 2]
    if side == 0.0:
        return gu, gv, huu, huv, hvv, su, suv, sv
    u0, u1, v0, v1 = nurbs.bounds(data, layout)
    rho = v - v0 if side > 0 else v1 - v
    i = 1.0 / rho
    k = (u1 - u0) / (2.0 * np.pi)
    if rho < nurbs.POLE_LIMIT * (v1 - v0):
        # S_u is lost in rounding: use S_u = rho S_uv, and the same curvature in all directions
        c = side * k
        x, y, z = c * d[4, 0], c * d[4, 1], c * d[4, 2]
        a12 = side * (x * d[2, 0] + y * d[2, 1] + z * d[2, 2])
        a22 = x * x + y * y + z * z
        bend = hvv / sv if sv > 0.0 else 1.0
        return side * gv, r0 * x + r1 * y + r2 * z, hvv, a12 * bend, a22 * bend, sv, a12, a22
    g1, g2 = side * gv, k * gu
    h12 = (side * k * huv - g2 * i) * i
    h22 = (k * k * huu * i + g1) * i
    return g1, g2 * i, hvv, h12, h22, sv, side * k * suv * i, k * k * su * i * i


@kernel
def _downhill(h11: float, h12: float, h22: float):
    """The smallest eigenvalue of a symmetric matrix and its eigenvector."""
    mean, half = 0.5 * (h11 + h22), 0.5 * (h11 - h22)
    root = np.hypot(half, h12)
    e1, e2 = (h12, -half - root) if half >= 0 else (half - root, h12)
    length = np.hypot(e1, e2)
    if length == 0.0:
        return mean - root, 1.0, 0.0
    return mean - root, e1 / length, e2 / length


@kernel
def flattest(data: Array, layout: Record, p0: float, p1: float, p2: float, v: float, d: Matrix):
    """The smallest eigenvalue of H in units of the metric (1 - d kappa if S_u and S_v are orthogonal), the parameters
    (du, dv) per metre along its direction, and whether the point is on a border collapsed to a point. Near a pole: 1
    and no direction."""
    r0, r1, r2 = d[0, 0] - p0, d[0, 1] - p1, d[0, 2] - p2
    if _polar(data, layout, v) != 0.0:
        return 1.0, 0.0, 0.0, False
    _, _, h11, h12, h22, a11, _, a22 = _model(data, layout, 0.0, v, d, r0, r1, r2)
    if min(a11, a22) <= 1e-14 * max(a11, a22):
        return 1.0, 0.0, 0.0, True
    q1, q2 = 1.0 / np.sqrt(a11), 1.0 / np.sqrt(a22)
    least, e1, e2 = _downhill(h11 * q1 * q1, h12 * q1 * q2, h22 * q2 * q2)
    return least, e1 * q1, e2 * q2, False


@kernel
def inside_border(data: Array, layout: Record, u: float, v: float, d: Matrix, share: float):
    """Parameters 2 % inside of a collapsed border, at the fraction `share` [1] of its length; d (6,3): derivatives."""
    u0, u1, v0, v1 = nurbs.bounds(data, layout)
    if d[1, 0] ** 2 + d[1, 1] ** 2 + d[1, 2] ** 2 <= d[2, 0] ** 2 + d[2, 1] ** 2 + d[2, 2] ** 2:
        inside = 0.02 if v - v0 <= v1 - v else -0.02
        return u0 + share * (u1 - u0), v + inside * (v1 - v0)
    inside = 0.02 if u - u0 <= u1 - u else -0.02
    return u + inside * (u1 - u0), v0 + share * (v1 - v0)


@kernel
def _line(
    data: Array,
    layout: Record,
    first: Indices,
    p0: float,
    p1: float,
    p2: float,
    u: float,
    v: float,
    work: Array,
    d: Matrix,
):
    """The vector r [m] (3) from p to the surface at (u, v), and r.r; fills d with the derivatives there."""
    nurbs.evaluate(data, layout, first, u, v, work, d)
    r0, r1, r2 = d[0, 0] - p0, d[0, 1] - p1, d[0, 2] - p2
    return r0, r1, r2, r0 * r0 + r1 * r1 + r2 * r2


@kernel
def newton(
    data: Array,
    layout: Record,
    first: Indices,
    p0: float,
    p1: float,
    p2: float,
    u: float,
    v: float,
    work: Array,
    d: Matrix,
):
    """Local minimum of the distance from p, by Newton's method from (u, v). Returns its u, v and squared distance [m²],
    and fills d (6,3) with the derivatives there."""
    u, v = _move_parameters(data, layout, 0.0, u, v, 0.0, 0.0)
    r0, r1, r2, f = _line(data, layout, first, p0, p1, p2, u, v, work, d)
    u0, u1, v0, v1 = nurbs.bounds(data, layout)
    steep = False
    escapes = 0
    for _ in range(LIMIT):
        if f <= ZERO_DISTANCE * ZERO_DISTANCE:
            break
        # gradient g and Hessian h of r.r / 2, metric a of the surface; near a pole in plane polar coordinates
        side = _polar(data, layout, v)
        g1, g2, h11, h12, h22, a11, a12, a22 = _model(data, layout, side, v, d, r0, r1, r2)
        # active set: a parameter at its limit is fixed while the distance decreases outwards
        hold1 = hold2 = False
        if side == 0.0:
            hold1 = not layout.closed_u and ((u <= u0 and g1 > 0.0) or (u >= u1 and g1 < 0.0))
            hold2 = not layout.closed_v and ((v <= v0 and g2 > 0.0) or (v >= v1 and g2 < 0.0))
        # stationary: r is normal to the surface, within ZERO_COSINE
        flat1 = hold1 or g1 * g1 <= ZERO_COSINE**2 * f * a11
        flat2 = hold2 or g2 * g2 <= ZERO_COSINE**2 * f * a22
        if flat1 and flat2:
            # a minimum if the smallest eigenvalue is not negative; else a saddle: leave it along the eigenvector
            if (hold1 and hold2) or escapes == 3 or not (a11 > 0.0 and a22 > 0.0):
                break
            if hold1:
                least, e1, e2 = h22 / a22, 0.0, 1.0
            elif hold2:
                least, e1, e2 = h11 / a11, 1.0, 0.0
            else:
                least, e1, e2 = _downhill(h11 / a11, h12 / np.sqrt(a11 * a22), h22 / a22)
            if least >= -1e-6:
                break
            escapes += 1
            away = 0.05 * np.sqrt(f)
            u, v = _move_parameters(data, layout, side, u, v, away * e1 / np.sqrt(a11), away * e2 / np.sqrt(a22))
            r0, r1, r2, f = _line(data, layout, first, p0, p1, p2, u, v, work, d)
            continue
        # Newton's direction, at most 25 % of the patch; steepest descent after a failed line search
        s1, s2 = _direction(g1, g2, h11, h12, h22, a11, a22, hold1, hold2, steep)
        reach = max(abs(s1) / (u1 - u0), abs(s2) / (v1 - v0)) if side == 0.0 else np.hypot(s1, s2) / (v1 - v0)
        if reach > 0.25:
            s1, s2 = s1 * 0.25 / reach, s2 * 0.25 / reach
        move = np.sqrt(max(a11 * s1 * s1 + 2.0 * a12 * s1 * s2 + a22 * s2 * s2, 0.0))
        slope = g1 * s1 + g2 * s2
        # backtracking line search by halves, Armijo's rule
        share = 1.0
        taken = False
        for _ in range(40):
            x, y = _move_parameters(data, layout, side, u, v, share * s1, share * s2)
            r0, r1, r2, new = _line(data, layout, first, p0, p1, p2, x, y, work, d)
            if side == 0.0 and not layout.closed_u and x - u != share * s1:
                slope = (g1 * (x - u)) / share + g2 * s2
            # the tolerance accepts last steps whose gain is lost in the rounding of r.r
            if new <= f + 2e-4 * share * min(slope, 0.0) + 1e-15 * f or share * move <= ZERO_MOVE:
                taken = True
                break
            share *= 0.5
        if taken:
            u, v, f, steep = x, y, new, False
            if share * move <= ZERO_MOVE:
                break
        else:
            r0, r1, r2, f = _line(data, layout, first, p0, p1, p2, u, v, work, d)
            if steep:
                break
            steep = True
    return u, v, f


@kernel
def _direction(
    g1: float,
    g2: float,
    h11: float,
    h12: float,
    h22: float,
    a11: float,
    a22: float,
    hold1: bool,
    hold2: bool,
    steep: bool,
):
    """Newton's step, with the magnitudes of the eigenvalues if H is not positive definite, without the fixed
    parameters. `steep`: the scaled negative gradient."""
    if hold1 or hold2 or steep:
        s1 = 0.0 if hold1 or a11 <= 0.0 else -g1 / (a11 if steep else max(abs(h11), 1e-6 * a11))
        s2 = 0.0 if hold2 or a22 <= 0.0 else -g2 / (a22 if steep else max(abs(h22), 1e-6 * a22))
        return s1, s2
    det = h11 * h22 - h12 * h12
    if h11 > 0.0 and h22 > 0.0 and det > 1e-10 * h11 * h22:
        return (h12 * g2 - h22 * g1) / det, (h12 * g1 - h11 * g2) / det
    if not (a11 > 0.0 and a22 > 0.0):
        return (-g1 / a11 if a11 > 0.0 else 0.0), (-g2 / a22 if a22 > 0.0 else 0.0)
    q1, q2 = 1.0 / np.sqrt(a11), 1.0 / np.sqrt(a22)
    least, e1, e2 = _downhill(h11 * q1 * q1, h12 * q1 * q2, h22 * q2 * q2)
    most = h11 * q1 * q1 + h22 * q2 * q2 - least
    along = (g1 * q1 * e1 + g2 * q2 * e2) / max(abs(least), 1e-6)
    across = (g2 * q2 * e1 - g1 * q1 * e2) / max(abs(most), 1e-6)
    return -q1 * (along * e1 - across * e2), -q2 * (along * e2 + across * e1)
