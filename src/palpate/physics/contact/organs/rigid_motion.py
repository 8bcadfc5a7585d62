"""Rigid motion of two organs that touch: gaps, lever arms, and what their foundations yield within a step.

Organ b turns by R_b about c_b and moves by d_b. Candidate i is at x_bi on its surface at the start, and then at
X_b = c_b + d_b + R_b (x_b - c_b). With the normal n_i at the start, on both organs, D = X_1 - X_2 and h the unit vector
along a + b, a = R_1 n, b = R_2 n, the gap of the bodies without deformation is

    g_i = g_0i + h.D - n.(x_1 - x_2)

where a candidate that follows has new constants after a slide, with a normal of each organ (`following`)

and its derivatives by the motions of both organs, h, -h and the levers t_b by their rotations about their centres
C_b = c_b + d_b,

    t_1 = (X_1 - C_1) x h + a x D_h/|a + b|,    t_2 = -(X_2 - C_2) x h + b x D_h/|a + b|,    D_h = D - h (h.D)

So the force p_i h on the first and -p_i h on the second organ have the moments p_i t_b. They are those of forces along
one line: (C_1 + C_2 cancel) t_1 + t_2 = C_2 x h - C_1 x h; momentum and angular momentum are conserved, and the work
p.dg is that of the forces, for any rotation. h is a gradient: a closed motion does no work.

**A step.** The organs on foundations answer to the forces of a step at its end (`coupled`): with the motion that their
foundations expect if all forces stay, e_b (displacement and rotation), and their mobility A_b, the change of it per
change of the forces (`physics.bodies.floating.mobility`).
"""

import math

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Record, Vector3
from palpate.physics.bodies.floating.turning import cross, times, times_back, turned

CHANGED = 0.02  # [1] change of mobility, and [rad] of direction, from which a matrix with it is computed again
SLID = 1e-3  # [m] slide from which it is computed again

RIDE = {
    "at": (3,), "turn": (3,), "centre": (3,), "matrix": (3, 3),
    "ahead": (6,), "soft": (6, 3), "load": (6,), "built": (6, 3), "built_turn": (3,), "built_at": (3,),
}  # fmt: skip
"""Rigid motion of an organ: d [m], r [rad] about c [m]; R; e + A dL, A (`expect`); L [N, N m].
Of the last matrix: A, r and d."""


@kernel
def expect(ride: Record, expected: Matrix, mobility: Matrix, load: Array):
    """Fill `ahead` and `soft` from what a foundation sends: e (1,6) and A (6,3).

    load [N, N m] (6)  of the fingers in this step, about the centre of the organ; dL is its change
    """
    for i in range(3):
        shift = turn = 0.0
        for j in range(3):
            ride.soft[i, j], ride.soft[3 + i, j] = mobility[i, j], mobility[3 + i, j]
            shift += mobility[i, j] * (load[j] - ride.load[j])
            turn += mobility[3 + i, j] * (load[3 + j] - ride.load[3 + j])
        ride.ahead[i], ride.ahead[3 + i] = expected[0, i] + shift, expected[0, 3 + i] + turn
    for i in range(6):
        ride.load[i] = load[i]


@kernel
def orient(ride: Record):
    """Fill R of an organ."""
    turn = (ride.turn[0], ride.turn[1], ride.turn[2])
    for j in range(3):
        x, y, z = turned(turn, (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0))
        ride.matrix[0, j], ride.matrix[1, j], ride.matrix[2, j] = x, y, z


@kernel
def rotated(ride: Record, x: Vector3):
    """R x (3)."""
    return times(ride.matrix, x)


@kernel
def rotated_back(ride: Record, x: Vector3):
    """R' x (3)."""
    return times_back(ride.matrix, x)


@kernel
def placed(ride: Record, x: Vector3):
    """Place X [m] (3) in the world of a point x [m] (3) of an organ at the start."""
    c, d = ride.centre, ride.at
    y = rotated(ride, (x[0] - c[0], x[1] - c[1], x[2] - c[2]))
    return c[0] + d[0] + y[0], c[1] + d[1] + y[1], c[2] + d[2] + y[2]


@kernel
def placed_back(ride: Record, place: Vector3):
    """x [m] (3) of a place X."""
    c, d = ride.centre, ride.at
    y = rotated_back(ride, (place[0] - c[0] - d[0], place[1] - c[1] - d[1], place[2] - c[2] - d[2]))
    return c[0] + y[0], c[1] + y[1], c[2] + y[2]


@kernel
def place_cells(
    one: Record, two: Record, normal: Matrix, opposite: Matrix, first: Matrix, second: Matrix, turns: Matrix,
    levers: Matrix, rest: Array, before: Array, gap: Array,
):  # fmt: skip
    """Fill h [1] (3,m), t_1 and t_2 [m] (6,m) and g [m] (m) for the place of both organs.

    normal, opposite n_1, n_2, first x_1, second x_2 (m,3)  on the organs at the start
    rest g_0, before n.(x_1 - x_2) [m] (m)
    """
    for i in range(len(gap)):
        place_cell(one, two, normal, opposite, first, second, turns, levers, rest, before, gap, i)


@kernel
def place_cell(
    one: Record, two: Record, normal: Matrix, opposite: Matrix, first: Matrix, second: Matrix, turns: Matrix,
    levers: Matrix, rest: Array, before: Array, gap: Array, i: int,
):  # fmt: skip
    """`place_cells` of candidate i."""
    n, m = (normal[i, 0], normal[i, 1], normal[i, 2]), (opposite[i, 0], opposite[i, 1], opposite[i, 2])
    x, y = (first[i, 0], first[i, 1], first[i, 2]), (second[i, 0], second[i, 1], second[i, 2])
    c, e = one.centre, two.centre
    arm = rotated(one, (x[0] - c[0], x[1] - c[1], x[2] - c[2]))
    leg = rotated(two, (y[0] - e[0], y[1] - e[1], y[2] - e[2]))
    a, b = rotated(one, n), rotated(two, m)
    s = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
    size = math.sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    inverse = 1.0 / max(size, 1e-12)
    h = (inverse * s[0], inverse * s[1], inverse * s[2])
    d = (
        (c[0] + one.at[0] + arm[0]) - (e[0] + two.at[0] + leg[0]),
        (c[1] + one.at[1] + arm[1]) - (e[1] + two.at[1] + leg[1]),
        (c[2] + one.at[2] + arm[2]) - (e[2] + two.at[2] + leg[2]),
    )
    along = h[0] * d[0] + h[1] * d[1] + h[2] * d[2]
    gap[i] = rest[i] + (along - before[i])
    aside = (inverse * (d[0] - along * h[0]), inverse * (d[1] - along * h[1]), inverse * (d[2] - along * h[2]))
    t, u = cross(arm, h), cross(a, aside)
    v, w = cross(leg, h), cross(b, aside)
    for k in range(3):
        turns[k, i], levers[k, i], levers[3 + k, i] = h[k], t[k] + u[k], w[k] - v[k]


@kernel
def opened(by: Array, sign: float, turns: Matrix, levers: Matrix, i: int, begin: int):
    """J_b q of candidate i for a motion `by` [m, rad] (6) of an organ; sign 1, begin 0: first; -1, 3: second."""
    along = turns[0, i] * by[0] + turns[1, i] * by[1] + turns[2, i] * by[2]
    about = levers[begin, i] * by[3] + levers[begin + 1, i] * by[4] + levers[begin + 2, i] * by[5]
    return sign * along + about


@kernel
def has_changed(ride: Record):
    """Whether a matrix with the mobility of an organ must be computed again."""
    turn = way = 0.0
    for half in range(2):
        most = far = 0.0
        for i in range(3 * half, 3 * half + 3):
            for j in range(3):
                most = max(most, abs(ride.built[i, j]))
                far = max(far, abs(ride.soft[i, j] - ride.built[i, j]))
        if far > CHANGED * most:
            return True
    for i in range(3):
        turn, way = max(turn, abs(ride.turn[i] - ride.built_turn[i])), max(way, abs(ride.at[i] - ride.built_at[i]))
    return turn > CHANGED or way > SLID


@kernel
def keep_built(ride: Record):
    """Keep the place and the mobility for which a matrix is computed."""
    for i in range(3):
        ride.built_turn[i], ride.built_at[i] = ride.turn[i], ride.at[i]
        for j in range(3):
            ride.built[i, j], ride.built[3 + i, j] = ride.soft[i, j], ride.soft[3 + i, j]


@kernel
def apply(soft: Matrix, x: Vector3, row: int):
    """Three rows of a mobility times a vector (3)."""
    return (
        soft[row, 0] * x[0] + soft[row, 1] * x[1] + soft[row, 2] * x[2],
        soft[row + 1, 0] * x[0] + soft[row + 1, 1] * x[1] + soft[row + 1, 2] * x[2],
        soft[row + 2, 0] * x[0] + soft[row + 2, 1] * x[1] + soft[row + 2, 2] * x[2],
    )


@kernel
def moved_at(ride: Record, by: Array, place: Vector3):
    """Displacement [m] (3) at a place [m] (3) of the world by a motion [m, rad] (6) of an organ."""
    c, d = ride.centre, ride.at
    about = cross((by[3], by[4], by[5]), (place[0] - c[0] - d[0], place[1] - c[1] - d[1], place[2] - c[2] - d[2]))
    return by[0] + about[0], by[1] + about[1], by[2] + about[2]


@kernel
def torque_at(ride: Record, force: Vector3, place: Vector3):
    """Moment [N m] (3) about the centre of an organ of a force [N] (3) at a place [m] (3) of the world."""
    c, d = ride.centre, ride.at
    return cross((place[0] - c[0] - d[0], place[1] - c[1] - d[1], place[2] - c[2] - d[2]), force)


@kernel
def mobile_at(one: Record, two: Record, place: Vector3, out: Matrix):
    """Fill the mobility [m/N] (3,3) of both organs against each other at a place [m] (3) of the world."""
    for j in range(3):
        force = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        x, y = yields_at(one, force, place), yields_at(two, force, place)
        out[0, j], out[1, j], out[2, j] = x[0] + y[0], x[1] + y[1], x[2] + y[2]


@kernel
def yields_at(ride: Record, force: Vector3, place: Vector3):
    """Displacement [m] (3) of an organ by a force [N] (3) at a place [m] (3)."""
    shift, turn = apply(ride.soft, force, 0), apply(ride.soft, torque_at(ride, force, place), 3)
    c, d = ride.centre, ride.at
    about = cross(turn, (place[0] - c[0] - d[0], place[1] - c[1] - d[1], place[2] - c[2] - d[2]))
    return shift[0] + about[0], shift[1] + about[1], shift[2] + about[2]
