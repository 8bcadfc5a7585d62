"""Friction of two bodies that slide on each other: one viscoelastic Coulomb patch, implicit in time with both bodies.

The patch are the candidates that touch, with the shares w_i = p_i/N of the normal force N = sum p_i. Their relative
displacement along the surface is d = sum_i w_i (d_1i - d_2i) [m] (3); that of body b at candidate i, of which only the
part along the tangents t_1, t_2 counts, is that of a Kelvin-Voigt solid under all loads, as the opening (`between`):

    d_bi = m_b (sum_j D_b,ij f_j + o_bi) + (1 - m_b) d_bi'

f_j are normal and friction forces of the contact, o_bi comes from all other loads. The friction F on the second body,
-F on the first, is spread with w. A step moves the patch by v T = e - C F, with e the motion without the friction of
this step and C = sum_ij w_i w_j (m_1 D_1,ij + m_2 D_2,ij) (3,3), and the bristles, of the stiffness k, follow:

    (I/k + C + l I) F = z + e,    z+ = F/k,    l >= 0,    |F| <= mu N,    l (mu N - |F|) = 0

Candidate i gets the part of its share along its surface, f_i = w_i (I - n_i n_i') F, conjugate to d: |f_i| <= mu p_i.
On a curved patch F and v also have a part along the mean normal, by motions towards it along inclined surfaces.

l F is the plastic slip: along the force, as A. Coulomb's law wants it, also where the bodies yield by different amounts
along and across the motion. l is found by Newton's method for 1/|F| (J. J. More, D. C. Sorensen, SIAM J. Sci. Stat.
Comput. 4 (1983) 553-572). A film of the viscosity c N [N s/m] in parallel replaces e and C by A e and A C,
A = (I + C c N/T)^-1, and adds c N v.

Passive: the plastic slip v T - (z+ - z) = l F dissipates l |F|² >= 0, and F.(z+ - z) is at least the increase of the
energy |F|²/(2 k) of the bristles. The work of the friction on the surfaces is -F.v T for the shares of this step.

J. C. Simo, T. A. Laursen, Comput. Struct. 42 (1992) 97-116, as `physics.friction.coulomb`.
Range: as `between`: slides that are small against the radii of curvature.
"""

from typing import Annotated, NamedTuple

import numpy as np

from palpate.compiler.exact import solve_in_place
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array, Matrix
from palpate.physics.contact.organs.between import Pair, take

EXACT, MOST_STEPS = 1e-12, 50  # [1] excess of the force over its limit; steps of Newton's method

LAW = {"mu": (), "stiffness": (), "viscous": ()}
"""mu [1]; k [N/m]; c [s/m]."""
BALANCE = {"stored": (), "dissipated": (), "slipped": ()}
"""Energy [J] of the bristles, dissipated since the start; path [m] of the plastic slip since the start."""
LAW_TYPE, BALANCE_TYPE = element_type(LAW), element_type(BALANCE)


class Rubbing(NamedTuple):
    """Friction of two bodies on m candidates.

    tangents [1] (2,m,3)       t_1, t_2
    first, second [m/N] (3m,2m) displacement of each candidate along its tangents, those along t_1 before those along
                               t_2, by a unit force on each candidate along n, t_1 and t_2; forces on a body act towards
                               +n on the first and -n on the second
    others  [m] (2,2m)         o_b
    moved   [m] (2,2m)         d_b
    before  [m] (2,2m)         d_b at the start of the step
    carried [m] (3)            motion of the first body's foundation against the second's in this step
    force   [N] (m,3)          friction on the first body at each candidate
    touched (m)                whether a candidate touched in the last step
    bristle [m] (3) z;  total [N] (3) F;  speed [m/s] (3) v
    mobile  [m/N] (3,3)        mobility of both organs on their foundations, with `carried` that for F of the last step;
                               (0,0): they do not move by their contact
    answer  [N] (3)            F of `solve_rubbing`
    matrix, given              workspaces
    """

    tangents: Annotated[np.ndarray, "<f8", 3]
    first: Annotated[np.ndarray, "<f8", 2]
    second: Annotated[np.ndarray, "<f8", 2]
    others: Annotated[np.ndarray, "<f8", 2]
    moved: Annotated[np.ndarray, "<f8", 2]
    before: Annotated[np.ndarray, "<f8", 2]
    carried: Annotated[np.ndarray, "<f8", 1]
    force: Annotated[np.ndarray, "<f8", 2]
    touched: Annotated[np.ndarray, "<i8", 1]
    bristle: Annotated[np.ndarray, "<f8", 1]
    total: Annotated[np.ndarray, "<f8", 1]
    speed: Annotated[np.ndarray, "<f8", 1]
    mobile: Annotated[np.ndarray, "<f8", 2]
    answer: Annotated[np.ndarray, "<f8", 1]
    matrix: Annotated[np.ndarray, "<f8", 3]
    given: Annotated[np.ndarray, "<f8", 3]
    law: Annotated[np.ndarray, LAW_TYPE, 1]
    balance: Annotated[np.ndarray, BALANCE_TYPE, 1]


def rubbing(
    tangents: np.ndarray, first: np.ndarray, second: np.ndarray, mu: float, stiffness: float, viscous: float
) -> Rubbing:
    """Two bodies at rest; arguments as in `Rubbing` and `LAW`, mu and stiffness > 0."""
    size = tangents.shape[1]
    law = np.zeros(1, LAW_TYPE)
    law["mu"], law["stiffness"], law["viscous"] = mu, stiffness, viscous
    return Rubbing(
        np.ascontiguousarray(tangents), np.ascontiguousarray(first), np.ascontiguousarray(second),
        np.zeros((2, 2 * size)), np.zeros((2, 2 * size)), np.zeros((2, 2 * size)), np.zeros(3), np.zeros((size, 3)),
        np.zeros(size, np.int64), np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((0, 0)), np.zeros(3),
        np.zeros((3, 3, 3)),
        np.zeros((2, 3, 4)), law, np.zeros(1, BALANCE_TYPE),
    )  # fmt: skip


@kernel
def _drag(pair: Pair, rub: Rubbing, body: int, drags: Matrix, dt: float):
    """Place a body's candidates along the surface by all loads but the friction of this step: by the memory of the last
    step, the other loads and the normal forces."""
    share, size, active = take(pair, body, dt), len(rub.touched), pair.active
    moved, others = rub.moved[body], rub.others[body]
    for i in range(2 * size):
        moved[i] = share * others[i] + (1.0 - share) * rub.before[body, i]
    for k in range(active.tally[0].active):
        j = active.order[k]
        row, push = drags[j], share * active.force[j]
        for i in range(2 * size):
            moved[i] += push * row[i]


@kernel
def _mean(pair: Pair, rub: Rubbing, total: float, out: Array):
    """Fill `out` [m] (3): motion of the patch in this step so far."""
    size, active = len(rub.touched), pair.active
    out[:] = 0.0
    for k in range(active.tally[0].active):
        i = active.order[k]
        weight = active.force[i] / total
        for a in range(2):
            at = a * size + i
            by = (rub.moved[0, at] - rub.before[0, at]) - (rub.moved[1, at] - rub.before[1, at])
            for x in range(3):
                by += rub.carried[x] * rub.tangents[a, i, x]
            for x in range(3):
                out[x] += weight * by * rub.tangents[a, i, x]


@kernel
def _yields(pair: Pair, rub: Rubbing, total: float, dt: float):
    """Fill the first matrix with C [m/N] (3,3)."""
    size, active, out = len(rub.touched), pair.active, rub.matrix[0]
    first, second = take(pair, 0, dt), take(pair, 1, dt)
    out[:] = 0.0
    for k in range(active.tally[0].active):
        j = active.order[k]
        for b in range(2):
            one, other = rub.first[(b + 1) * size + j], rub.second[(b + 1) * size + j]
            for q in range(active.tally[0].active):
                i = active.order[q]
                weight = active.force[i] * active.force[j] / (total * total)
                for a in range(2):
                    by = weight * (first * one[a * size + i] + second * other[a * size + i])
                    for x in range(3):
                        for y in range(3):
                            out[x, y] += by * rub.tangents[a, i, x] * rub.tangents[b, j, y]


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
    for x in range(3):
        rub.bristle[x] = rub.total[x] = rub.speed[x] = rub.carried[x] = 0.0
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
    _drag(pair, rub, 0, rub.first, dt)
    _drag(pair, rub, 1, rub.second, dt)
    normal = 0.0
    for k in range(active.tally[0].active):
        normal += active.force[active.order[k]]
    rub.answer[:] = 0.0
    if not normal > 0.0:
        return 0.0
    free, film = rub.given[1, 0, :3], law.viscous * normal / dt
    _mean(pair, rub, normal, free)
    _yields(pair, rub, normal, dt)
    for x in range(len(rub.mobile)):
        for y in range(3):
            rub.matrix[0, x, y] += rub.mobile[x, y]
            free[x] += rub.mobile[x, y] * rub.total[y]
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
    """After `solve_rubbing`, which returned `normal`: fills `rub.force`, `total`, and `speed`."""
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
        work += force * way + film * way * way - 0.5 * (force * held - law.stiffness * before * before)
        slip += (way - (held - before)) ** 2
        square += force * force
        rub.bristle[x], rub.speed[x], rub.total[x] = held, way / dt, force + film * way
    balance.dissipated += work
    balance.stored = 0.5 * square / law.stiffness
    balance.slipped += np.sqrt(slip)
    _spread(pair, rub, normal, dt)


@ieee_kernel
def step_rubbing(pair: Pair, rub: Rubbing, dt: float):
    """A step after the normal contact (`between.step_pair`), dt > 0 [s]: fills `rub.force`, `total`, and `speed`."""
    begin_rubbing(rub)
    end_rubbing(pair, rub, solve_rubbing(pair, rub, dt), dt)


@kernel
def pull_of(pair: Pair, rub: Rubbing, total: float, out: Array):
    """Fill `out` [N] (3): sum of the forces on the first body that `answer` will be spread to, on the tangents of the
    candidates; total [N] > 0 of their normal forces."""
    active = pair.active
    out[:] = 0.0
    for k in range(active.tally[0].active):
        j = active.order[k]
        weight = active.force[j] / total
        for a in range(2):
            along = 0.0
            for x in range(3):
                along += weight * rub.answer[x] * rub.tangents[a, j, x]
            for x in range(3):
                out[x] -= along * rub.tangents[a, j, x]


@kernel
def _spread(pair: Pair, rub: Rubbing, total: float, dt: float):
    """Spread the friction over the candidates, and move both bodies by it."""
    size, active = len(rub.touched), pair.active
    first, second = take(pair, 0, dt), take(pair, 1, dt)
    rub.touched[:] = 0
    for k in range(active.tally[0].active):
        j = active.order[k]
        rub.touched[j] = 1
        weight = active.force[j] / total
        for a in range(2):
            along = 0.0
            for x in range(3):
                along += weight * rub.total[x] * rub.tangents[a, j, x]
            for x in range(3):
                rub.force[j, x] -= along * rub.tangents[a, j, x]
            one, other = rub.first[(a + 1) * size + j], rub.second[(a + 1) * size + j]
            for i in range(2 * size):
                rub.moved[0, i] -= first * along * one[i]
                rub.moved[1, i] += second * along * other[i]


@kernel
def open_by_friction(rub: Rubbing, others: Matrix):
    """Add to `others` [m] (2,m) the opening of the candidates by the friction of the last step (E. Betti)."""
    size = len(rub.touched)
    for j in range(size):
        if rub.touched[j] == 0:
            continue
        for a in range(2):
            along = 0.0
            for x in range(3):
                along += rub.force[j, x] * rub.tangents[a, j, x]
            at = a * size + j
            for i in range(size):
                others[0, i] += along * rub.first[i, at]
                others[1, i] -= along * rub.second[i, at]
