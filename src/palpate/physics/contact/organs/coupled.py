"""All contacts of organs that share organs on foundations, in one problem: none answers to another a step later.

Organ b moves in a step by

    x_b = e_b + A_b (dL_b + sum_k (J_kb' p_k + R_kb - Q_kb))

e_b is the motion that its foundation expects if all forces stay, A_b its mobility, dL_b the change of the load of the
fingers, J_kb the derivatives of the gaps of contact k (`rigid_motion`), p_k its forces, R_kb its friction, and Q_kb the
force and moment that it sent in the last step, J' p + R of then: J turns with the organs, so that forces p that stay
change their directions. The gaps at the end of the step are

    w_k = g_k + u_k1 + u_k2 + J_k1 x_1 + J_k2 x_2 = ... + W_k p_k + sum_l J_k A J_l' p_l

so that all p solve one linear complementarity problem with the symmetric matrix W + J A J' (`pivoting`).

**Energy.** With the implicit step of the foundations (`bodies.floating.foundation`) and of the bodies (`between`), the
energy of organs, foundations and bodies rises by at most the work of the fingers and sum_k p_k.(w_k - w_k'), w' the
gaps at the start. p.w = 0, p >= 0, and w' >= 0, since every step ends without overlap: it never rises, for any masses,
stiffness and step. That holds where A_b is the change of the motion of the organ, as of attached organs; a loose one
that leaves its foundation, or lands, within a step may move otherwise: then w' is not as expected, and what the contact
gives is counted.

**Friction** of contact k moves all organs, and so the gaps and the friction of the others. Normal forces and frictions
are solved in turn until both change by less than `SETTLED`, at most `SWEEPS` times. The matrix is that of a place and a
mobility a little earlier (`rigid_motion.has_changed`): each turn also removes what is left of the gaps by that.

J. J. Moreau, in: Nonsmooth Mechanics and Applications (Springer 1988) 1-82. D. E. Stewart, J. C. Trinkle, Int. J.
Numer. Methods Eng. 39 (1996) 2673-2691: implicit steps of rigid bodies as one complementarity problem.
"""

from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix, Record, Vector3
from palpate.physics.contact.organs.rigid_motion import apply, opened

SWEEPS = 20  # most solutions of the normal forces in a step
SETTLED = 1e-9  # [m] of the gaps that bear, and [1] of the friction over the normal force

ORGAN = {"free": (6,), "pushed": (6,), "rubbed": (6,), "moved": (6,)}
"""Motion of an organ [m, rad] without the normal forces of this step; by these; by the change of friction; in all."""


@kernel
def clear_wrench(wrench: Array):
    """Set a force and moment to zero."""
    for i in range(6):
        wrench[i] = 0.0


@kernel
def add_push(wrench: Array, force: float, turns: Matrix, levers: Matrix, i: int, side: int):
    """Add J_i' p_i of candidate i, force and moment [N, N m] (6) on an organ; side 0: the first, 1: the second."""
    sign = force if side == 0 else -force
    for x in range(3):
        wrench[x] += sign * turns[x, i]
        wrench[3 + x] += force * levers[3 * side + x, i]


@kernel
def add_motion(ride: Record, wrench: Array, share: float, out: Array):
    """Add to `out` [m, rad] (6) the motion of an organ by `share` times a force and moment (6): A L."""
    shift = apply(ride.soft, (wrench[0], wrench[1], wrench[2]), 0)
    about = apply(ride.soft, (wrench[3], wrench[4], wrench[5]), 3)
    for x in range(3):
        out[x] += share * shift[x]
        out[3 + x] += share * about[x]


@kernel
def opening_of(one: Array, two: Array, turns: Matrix, levers: Matrix, i: int):
    """J_1 x_1 + J_2 x_2 [m] of candidate i by motions of both organs (6)."""
    return opened(one, 1.0, turns, levers, i, 0) + opened(two, -1.0, turns, levers, i, 3)


@kernel
def _rows(soft: Matrix, side: int, turns: Matrix, levers: Matrix, i: int):
    """A_b J_i' of candidate i: two vectors (3)."""
    sign = 1.0 if side == 0 else -1.0
    shift: Vector3 = (sign * turns[0, i], sign * turns[1, i], sign * turns[2, i])
    about: Vector3 = (levers[3 * side, i], levers[3 * side + 1, i], levers[3 * side + 2, i])
    return apply(soft, shift, 0), apply(soft, about, 3)


@ieee_kernel
def add_block(
    soft: Matrix, side: int, turns: Matrix, levers: Matrix, other: int, turns_2: Matrix, levers_2: Matrix, out: Matrix,
    row: int, column: int,
):  # fmt: skip
    """Add J A J' [m/N] of an organ, which is the `side` of one contact and the side `other` of a second one, to the
    block of a matrix that begins at `row` and `column`."""
    for i in range(turns.shape[1]):
        add_row(soft, side, turns, levers, i, other, turns_2, levers_2, out[row + i][column:])


@ieee_kernel
def add_row(
    soft: Matrix, side: int, turns: Matrix, levers: Matrix, i: int, other: int, turns_2: Matrix, levers_2: Matrix,
    out: Array,
):  # fmt: skip
    """`add_block` for candidate i of the first contact, to a row of the matrix from its column on."""
    sign, k = 1.0 if other == 0 else -1.0, 3 * other
    p, q = _rows(soft, side, turns, levers, i)
    for j in range(turns_2.shape[1]):
        h = p[0] * turns_2[0, j] + p[1] * turns_2[1, j] + p[2] * turns_2[2, j]
        t = q[0] * levers_2[k, j] + q[1] * levers_2[k + 1, j] + q[2] * levers_2[k + 2, j]
        out[j] += sign * h + t
