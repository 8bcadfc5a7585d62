"""Rotations by a vector r = a theta [rad] (3), axis times angle, in kernels.

    R(r) x = x + s r x x + c r x (r x x),    s = sin(theta)/theta,    c = (1 - cos(theta))/theta²
    omega = J(r) r',    J w = w + c r x w + (1 - s)/theta² r x (r x w),    J(r)^T = J(-r)

For all r; J is singular at theta = 2 pi. J. Argyris, Comput. Methods Appl. Mech. Eng. 32 (1982) 85-155.
"""

import math

from palpate.compiler.angles import sin
from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Matrix, Vector3

SMALL = 1e-2  # [rad] angle below which (1 - s)/theta² is a series, exact to rounding there


@kernel
def cross(a: Vector3, b: Vector3):
    """a x b (3)."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def times(m: Matrix, x: Vector3):
    """M x (3) of a matrix (3,3)."""
    return (
        m[0, 0] * x[0] + m[0, 1] * x[1] + m[0, 2] * x[2],
        m[1, 0] * x[0] + m[1, 1] * x[1] + m[1, 2] * x[2],
        m[2, 0] * x[0] + m[2, 1] * x[1] + m[2, 2] * x[2],
    )


@kernel
def times_back(m: Matrix, x: Vector3):
    """M' x (3)."""
    return (
        m[0, 0] * x[0] + m[1, 0] * x[1] + m[2, 0] * x[2],
        m[0, 1] * x[0] + m[1, 1] * x[1] + m[2, 1] * x[2],
        m[0, 2] * x[0] + m[1, 2] * x[1] + m[2, 2] * x[2],
    )


@kernel
def _factors(r: Vector3):
    """s, c and (1 - s)/theta² [1]."""
    square = dot(r, r)
    angle = math.sqrt(square)
    if angle < SMALL:
        series = (1.0 - square / 20.0 * (1.0 - square / 42.0)) / 6.0
        return 1.0 - square * series, 0.5 - square / 24.0 * (1.0 - square / 30.0), series
    s, half = sin(angle) / angle, sin(0.5 * angle) / angle
    return s, 2.0 * half * half, (1.0 - s) / square


@kernel
def turned(r: Vector3, x: Vector3):
    """R(r) x (3); the inverse is `turned` by -r."""
    s, c, _ = _factors(r)
    y = cross(r, x)
    z = cross(r, y)
    return x[0] + s * y[0] + c * z[0], x[1] + s * y[1] + c * z[1], x[2] + s * y[2] + c * z[2]


@kernel
def turned_back(r: Vector3, x: Vector3):
    """R(r)^T x (3)."""
    return turned((-r[0], -r[1], -r[2]), x)


@kernel
def spin(r: Vector3, w: Vector3):
    """omega = J(r) w [rad/s] (3) of the rates w = r' [rad/s] (3)."""
    _, c, series = _factors(r)
    y = cross(r, w)
    z = cross(r, y)
    return w[0] + c * y[0] + series * z[0], w[1] + c * y[1] + series * z[1], w[2] + c * y[2] + series * z[2]


@kernel
def moment_on(r: Vector3, torque: Vector3):
    """J(r)^T torque [N m] (3), the moment that works on r."""
    return spin((-r[0], -r[1], -r[2]), torque)
