"""Grip and load force of several contacts on one body.

Forces f_i at points p_i move the body by their wrench G f, with the grasp matrix G, and squeeze it by the internal
forces, their projection on the null space of G (J. Kerr & B. Roth, Int. J. Robotics Res. 4 (1986) 3-17),

    q_i = f_i - mean(f) - b x r_i,    sum_i r_i x (b x r_i) = sum_i r_i x f_i,    r_i = p_i - mean(p)

For two contacts they lie on the line through both: q_1 = -q_2 = ((f_1 - f_2).e/2) e (T. Yoshikawa & K. Nagai, IEEE
Trans. Robotics Autom. 7 (1991) 67-77).
"""

import math

import numpy as np

from palpate.compiler.dot import dot
from palpate.compiler.kernel import ieee_kernel
from palpate.physics.arrays import Array, Matrix

BALANCED = 1e-12  # [1] Moment over the sum of |r_i| |f_i| that counts as zero


@ieee_kernel
def _cross(a: Array, b: Array, out: Array):
    out[0] += a[1] * b[2] - a[2] * b[1]
    out[1] += a[2] * b[0] - a[0] * b[2]
    out[2] += a[0] * b[1] - a[1] * b[0]


@ieee_kernel
def internal_forces(points: Matrix, forces: Matrix):
    """The internal forces q [N] (k,3) and the arms r [m] (k,3), of forces [N] (k,3) at points [m] (k,3).

    b is computed by three steps of conjugate gradients, also for collinear points, for which the component of b along
    their line is undetermined and has no effect.
    """
    count = len(points)
    # forces without their mean, arms from the centre, and the remaining moment
    arm, left = points.copy(), forces.copy()
    for axis in range(3):
        centre, mean = points[:, axis].mean(), forces[:, axis].mean()
        for i in range(count):
            arm[i, axis] -= centre
            left[i, axis] -= mean
    moment, scale = np.zeros(3), 0.0
    for i in range(count):
        _cross(arm[i], left[i], moment)
        scale += math.sqrt(dot(arm[i], arm[i]) * dot(left[i], left[i]))
    # b (`turn`) by conjugate gradients
    turn, along, size = np.zeros(3), moment.copy(), dot(moment, moment)
    for _ in range(3):
        if size <= (BALANCED * scale) ** 2:
            break
        image = np.zeros(3)
        for i in range(count):
            push = np.zeros(3)
            _cross(along, arm[i], push)
            _cross(arm[i], push, image)
        step = size / dot(along, image)
        turn += step * along
        moment -= step * image
        before, size = size, dot(moment, moment)
        along = moment + size / before * along
    for i in range(count):
        push = np.zeros(3)
        _cross(turn, arm[i], push)
        left[i] -= push
    return left, arm


@ieee_kernel
def grip_force(points: Matrix, forces: Matrix):
    """Grip force sum_i |q_i|/2 [N], that of each of two opposing fingers; negative if they pull, sum_i q_i.r_i > 0.
    points [m] (k,3), forces [N] (k,3)."""
    internal, arm = internal_forces(points, forces)
    total = outward = 0.0
    for i in range(len(points)):
        total += math.sqrt(dot(internal[i], internal[i]))
        outward += dot(internal[i], arm[i])
    return 0.5 * total if outward <= 0.0 else -0.5 * total
