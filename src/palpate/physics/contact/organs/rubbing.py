"""Friction of two bodies that slide on each other: one viscoelastic Coulomb patch, implicit in time with both bodies.

The patch are the candidates that touch, with the shares w_i = p_i/N of the normal force N = sum p_i. Each body has
tangents t_1, t_2 at each candidate in its axes, which R_b turns to those of the patch (the world; `rubbing_axes`). The
relative motion of the patch along the surfaces in a step is (3) [m]

    e = sum_i w_i (R_1 d_1i - R_2 d_2i) + P q,    P = 1/2 sum_b R_b sum_i w_i (I - n_bi n_bi') R_b'

q is the rigid motion of the first body against the second at the patch; d_bi the change of the displacement of body b
at candidate i along its tangents, of a Kelvin-Voigt solid under all loads, as the opening (`between`):

    u_bi = m_b (sum_j D_b,ij f_j + o_bi) + (1 - m_b) u_bi'

f_j are normal and friction forces of the contact, o_bi comes from all other loads. The friction F on the second body,
-F on the first, is spread with w. A step moves the patch by v T = e - C F, with e the motion without the friction of
this step and C = sum_b m_b R_b (sum_ij w_i w_j D_b,ij) R_b' (3,3), and the bristles, of the stiffness k, follow:

    (I/k + C + l I) F = z + e,    z+ = F/k,    l >= 0,    |F| <= mu N,    l (mu N - |F|) = 0

Candidate i of body b gets the part of its share along its surface, f_bi = -+w_i (I - n_bi n_bi') R_b' F, conjugate to
d_bi: |f_bi| <= mu p_i. The bodies as a whole get -P F and P F at one place, conjugate to q: action is reaction, also
where the normals of both bodies at a candidate differ, because they have turned since these were computed. On a curved
patch F and v also have a part along the mean normal, by motions towards it along inclined surfaces.

l F is the plastic slip: along the force, as A. Coulomb's law wants it, also where the bodies yield by different amounts
along and across the motion. l is found by Newton's method for 1/|F| (J. J. More, D. C. Sorensen, SIAM J. Sci. Stat.
Comput. 4 (1983) 553-572). A film of the viscosity c N [N s/m] in parallel replaces e and C by A e and A C,
A = (I + C c N/T)^-1, and adds c N v. Bodies on foundations answer to -P F by the mobility M: C is C + P M P.

Passive: the plastic slip v T - (z+ - z) = l F dissipates l |F|² >= 0, and F.(z+ - z) is at least the increase of the
energy |F|²/(2 k) of the bristles, which turn without a change of |z|. The work of the friction on the surfaces is
-F.v T for the shares of this step. All of it that the bristles do not store is dissipated: also what they stored before
a turn by 180° within a step, which leaves them no direction (`rubbing_axes`), and before the bodies part.

J. C. Simo, T. A. Laursen, Comput. Struct. 42 (1992) 97-116, as `physics.friction.coulomb`.
Range: as `between`: slides that are small against the radii of curvature, and any rotation of the bodies.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.exact import solve_in_place
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array
from palpate.physics.bodies.floating.turning import times
from palpate.physics.contact.organs.between import Pair
from palpate.physics.contact.organs.rubbing_axes import add_turned, keep_turned, turn_bristles
from palpate.physics.contact.organs.rubbing_patch import drag, gather, spread, yields

EXACT, MOST_STEPS = 1e-12, 50  # [1] excess of the force over its limit; steps of Newton's method

LAW = {"mu": (), "stiffness": (), "viscous": ()}
"""mu [1]; k [N/m]; c [s/m]."""
BALANCE = {"stored": (), "dissipated": (), "slipped": ()}
"""Energy [J] of the bristles, dissipated since the start; path [m] of the plastic slip since the start."""
LAW_TYPE, BALANCE_TYPE = element_type(LAW), element_type(BALANCE)


class Rubbing(NamedTuple):
    """Friction of two bodies on m candidates.

    axes    [1] (2,3,3)        R_b
    tangents [1] (2,2,m,3)     t_1, t_2 on each body, in its axes
    first, second [m/N] (3m,2m) displacement of each candidate along its tangents, those along t_1 before those along
                               t_2, by a unit force on each candidate along n, t_1 and t_2; forces on a body act towards
                               +n on the first and -n on the second
    others  [m] (2,2m)         o_b
    moved   [m] (2,2m)         u_b
    before  [m] (2,2m)         u_b at the start of the step
    carried [m] (3)            q in this step
    force   [N] (2,m,3)        friction on each body at each candidate, in its axes
    touched (m)                whether a candidate touched in the last step
    bristles [m] (2,3)         z, `rubbing_axes.keep_turned`;  bristle (3)  the same for the patch in this step
    facing  [1] (2,3)          mean normal of the patch, likewise;  normal (3)
    total [N] (3) F;  pull [N] (3)  -P F, friction on the first body;  speed [m/s] (3) v
    mobile  [m/N] (3,3)        M, mobility of both organs on their foundations, with `carried` that without friction;
                               (0,0): they do not move by their contact
    answer  [N] (3)            F of `solve_rubbing`;  plane [1] (3,3) P
    block (3,3), matrix, given, along (2m), listed (m)  workspaces
    """

    axes: Annotated[np.ndarray, "<f8", 3]
    tangents: Annotated[np.ndarray, "<f8", 4]
    first: Annotated[np.ndarray, "<f8", 2]
    second: Annotated[np.ndarray, "<f8", 2]
    others: Annotated[np.ndarray, "<f8", 2]
    moved: Annotated[np.ndarray, "<f8", 2]
    before: Annotated[np.ndarray, "<f8", 2]
    carried: Annotated[np.ndarray, "<f8", 1]
    force: Annotated[np.ndarray, "<f8", 3]
    touched: Annotated[np.ndarray, "<i8", 1]
    bristles: Annotated[np.ndarray, "<f8", 2]
    bristle: Annotated[np.ndarray, "<f8", 1]
    facing: Annotated[np.ndarray, "<f8", 2]
    normal: Annotated[np.ndarray, "<f8", 1]
    total: Annotated[np.ndarray, "<f8", 1]
    pull: Annotated[np.ndarray, "<f8", 1]
    speed: Annotated[np.ndarray, "<f8", 1]
    mobile: Annotated[np.ndarray, "<f8", 2]
    answer: Annotated[np.ndarray, "<f8", 1]
    plane: Annotated[np.ndarray, "<f8", 2]
    block: Annotated[np.ndarray, "<f8", 2]
    matrix: Annotated[np.ndarray, "<f8", 3]
    given: Annotated[np.ndarray, "<f8", 3]
    along: Annotated[np.ndarray, "<f8", 1]
    listed: Annotated[np.ndarray, "<i8", 1]
    law: Annotated[np.ndarray, LAW_TYPE, 1]
    balance: Annotated[np.ndarray, BALANCE_TYPE, 1]


def rubbing(
    tangents: np.ndarray, first: np.ndarray, second: np.ndarray, mu: float, stiffness: float, viscous: float
) -> Rubbing:
    """Two bodies at rest, that have not turned: tangents [1] (2,m,3) of both; the other arguments as in `Rubbing` and
    `LAW`, mu and stiffness > 0."""
    size = tangents.shape[1]
    law = np.zeros(1, LAW_TYPE)
    law["mu"], law["stiffness"], law["viscous"] = mu, stiffness, viscous
    return Rubbing(
        np.stack([np.eye(3), np.eye(3)]), np.stack([tangents, tangents]), np.ascontiguousarray(first),
        np.ascontiguousarray(second), np.zeros((2, 2 * size)), np.zeros((2, 2 * size)), np.zeros((2, 2 * size)),
        np.zeros(3), np.zeros((2, size, 3)), np.zeros(size, np.int64), np.zeros((2, 3)), np.zeros(3), np.zeros((2, 3)),
        np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((0, 0)), np.zeros(3), np.zeros((3, 3)),
        np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros((2, 3, 4)), np.zeros(2 * size), np.zeros(size, np.int64), law,
        np.zeros(1, BALANCE_TYPE),
    )  # fmt: skip


@kernel
def _follow_mobility(rub: Rubbing):
    """Add the answer of the foundations to the friction to C."""
    if len(rub.mobile) > 0:
        add_turned(rub.plane, rub.mobile, 1.0, rub.matrix[0])


@ieee_kernel
def _solve_force(rub: Rubbing, free: Array, soft: float, limit: float):
    """Fill the first column of the first workspace with F [N] (3). soft [m/N] 1/k, limit [N] mu N."""
    given, scaled, slip = rub.given[:1, :, :2], rub.matrix[2], 0.0
    for _ in range(MOST_STEPS):
        for column in range(2):  # F, then (M + l I)^-1 F
            for x in range(3):
                for y in range(3):
                    scaled[x, y] = rub.matrix[0, x, y] + (soft + slip if x == y else 0.0)
                given[0, x, column] = rub.bristle[x] + free[x] if column == 0 else given[0, x, 0]
            solve_in_place(rub.matrix[2:3], given[:, :, column : column + 1])
        square = given[0, 0, 0] ** 2 + given[0, 1, 0] ** 2 + given[0, 2, 0] ** 2
        pull = np.sqrt(square)
        if pull <= limit * (1.0 + EXACT):
            break
        fall = given[0, 0, 0] * given[0, 0, 1] + given[0, 1, 0] * given[0, 1, 1] + given[0, 2, 0] * given[0, 2, 1]
        if not (limit > 0.0 and fall > 0.0):
            break
        slip += (pull / limit - 1.0) * square / fall
    share = limit / pull if pull > limit else 1.0
    for x in range(3):
        given[0, x, 0] *= share


@kernel
def _through_film(rub: Rubbing, free: Array, film: float):
    """Replace e and C by A e and A C, A = (I + C c N/T)^-1. film [N/m] c N/T > 0."""
    scaled, given = rub.matrix[1], rub.given[0]
    last = given.shape[1] - 1
    for x in range(3):
        for y in range(3):
            scaled[x, y] = film * rub.matrix[0, x, y] + (1.0 if x == y else 0.0)
            given[x, y] = rub.matrix[0, x, y]
        given[x, last] = free[x]
    solve_in_place(rub.matrix[1:2], rub.given[:1])
    for x in range(3):
        for y in range(3):
            rub.matrix[0, x, y] = given[x, y]
        free[x] = given[x, last]


@kernel
def _part(rub: Rubbing):
    """Forget the bristles of bodies that do not touch: their energy is lost."""
    balance = rub.balance[0]
    balance.dissipated += balance.stored
    balance.stored = 0.0
    rub.bristles[:] = 0.0
    for x in range(3):
        rub.bristle[x] = rub.total[x] = rub.pull[x] = rub.speed[x] = rub.carried[x] = 0.0
    rub.touched[:] = 0


@kernel
def begin_rubbing(rub: Rubbing):
    """Keep the places of the candidates at the start of the step."""
    for body in range(2):
        for i in range(len(rub.moved[body])):
            rub.before[body, i] = rub.moved[body, i]


@ieee_kernel
def solve_rubbing(pair: Pair, rub: Rubbing, dt: float):
    """Fill `rub.answer`, F for the normal forces of the pair and the motion `rub.carried`; it may be called again with
    others. Returns the normal force [N]; 0: the bodies do not touch."""
    active, law = pair.active, rub.law[0]
    drag(pair, rub, 0, rub.first, dt)
    drag(pair, rub, 1, rub.second, dt)
    normal = 0.0
    for k in range(active.tally[0].active):
        normal += active.force[active.order[k]]
    rub.answer[:] = 0.0
    if not normal > 0.0:
        return 0.0
    free, film = rub.given[1, 0, :3], law.viscous * normal / dt
    gather(pair, rub, normal, free)
    turn_bristles(rub.axes, rub.bristles, rub.facing, rub.normal, rub.bristle)
    yields(pair, rub, normal, dt, rub.matrix[0])
    _follow_mobility(rub)
    if film > 0.0:
        _through_film(rub, free, film)
    _solve_force(rub, free, 1.0 / law.stiffness, law.mu * normal)
    for x in range(3):
        rub.answer[x] = rub.given[0, x, 0] + film * _way(rub, free, x)
    return normal


@kernel
def _way(rub: Rubbing, free: Array, x: int):
    """Motion [m] of the patch along an axis."""
    way = free[x]
    for y in range(3):
        way -= rub.matrix[0, x, y] * rub.given[0, y, 0]
    return way


@ieee_kernel
def end_rubbing(pair: Pair, rub: Rubbing, normal: float, dt: float):
    """After `solve_rubbing`, which returned `normal`: fills `rub.force`, `total`, `pull`, and `speed`."""
    law, balance = rub.law[0], rub.balance[0]
    rub.force[:] = 0.0
    if not normal > 0.0:
        _part(rub)
        return
    free, film = rub.given[1, 0, :3], law.viscous * normal / dt
    rub.carried[:] = 0.0
    work, slip, square = 0.0, 0.0, 0.0
    for x in range(3):
        force, way = rub.given[0, x, 0], _way(rub, free, x)
        before, held = rub.bristle[x], force / law.stiffness
        work += force * way + film * way * way
        slip += (way - (held - before)) ** 2
        square += force * force
        rub.bristle[x], rub.speed[x], rub.total[x] = held, way / dt, force + film * way
    stored = 0.5 * square / law.stiffness
    balance.dissipated += work - (stored - balance.stored)
    balance.stored = stored
    balance.slipped += np.sqrt(slip)
    keep_turned(rub.axes, rub.bristle, rub.bristles)
    keep_turned(rub.axes, rub.normal, rub.facing)
    rub.pull[0], rub.pull[1], rub.pull[2] = pull_of(rub, rub.total)
    spread(pair, rub, normal, dt)


@ieee_kernel
def step_rubbing(pair: Pair, rub: Rubbing, dt: float):
    """A step after the normal contact (`between.step_pair`), dt > 0 [s]; fills what `end_rubbing` fills."""
    begin_rubbing(rub)
    end_rubbing(pair, rub, solve_rubbing(pair, rub, dt), dt)


@kernel
def pull_of(rub: Rubbing, force: Array):
    """-P F (3) [N], after `solve_rubbing`: sum of the forces on the first body, on the tangents of the candidates."""
    x, y, z = times(rub.plane, force)
    return -x, -y, -z
