"""What an organ on a foundation will do in its next step, for contacts that solve with it.

If all forces stay as in the last step, it moves by e = (dd, dr): `foundation.step` on a copy of its state. A change of
the force F and the moment Q changes this by the mobility, of the implicit step in the state that it reaches,

    along u, across u, tilt, twist:    T²/(I + T c + T² k)

with inertia I, spring k and damper c of each (`foundation`); without the spring where that slips, and T²/I off the
foundation. An attached organ has exactly this mobility. That of a loose one is exact until its foundation begins or
ends to bear, stick or slip; along u it is that without the foundation unless other organs press it on it, because a
force that lifts it off would else move it more than expected, and do work.

Both are sent for the world's axes: the rotation J(r) dr and the mobility J A J' (`turning`).
"""

import math

from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Record, Vector3
from palpate.physics.bodies.floating.foundation import parts, step
from palpate.physics.bodies.floating.turning import spin

SLIPS = 1.0 - 1e-9  # [1] share of the limit from which a spring counts as slipping


@kernel
def _yields(inertia: float, k: float, c: float, stretch: float, limit: float, bears: float, dt: float):
    """Mobility of one of the springs that slip at a limit; `bears` scales its damper."""
    sticks = k * stretch < SLIPS * limit
    return dt * dt / (inertia + dt * (bears * c + (dt * k if sticks else 0.0)))


@kernel
def _along(up: Vector3, along: float, across: float, out: Matrix, row: int):
    """Fill three rows of `out` with along uu' + across (1 - uu')."""
    for i in range(3):
        for j in range(3):
            out[row + i, j] = (along - across) * up[i] * up[j] + (across if i == j else 0.0)


@kernel
def _turn(turn: Vector3, matrix: Matrix, row: int):
    """Replace three rows A of a matrix by J A J'."""
    for _ in range(2):  # J A, then J (J A)'
        for j in range(3):
            x, y, z = spin(turn, (matrix[row, j], matrix[row + 1, j], matrix[row + 2, j]))
            matrix[row, j], matrix[row + 1, j], matrix[row + 2, j] = x, y, z
        for i in range(3):
            for j in range(i):
                matrix[row + i, j], matrix[row + j, i] = matrix[row + j, i], matrix[row + i, j]


@kernel
def look_ahead(
    base: Record, up: Vector3, now: Record, ahead: Record, force: Vector3, moment: Vector3, added: Vector3,
    pressed: bool, dt: float, expected: Array, mobility: Matrix,
):  # fmt: skip
    """Fill `expected` [m, rad] (6) and `mobility` [m/N, 1/(N m)] (6,3), the rows of displacement and rotation.

    base, up, now, force, moment, added  of `foundation.step`, after it
    ahead    a record of the form of `now`, overwritten
    pressed  whether other organs press it on its foundation
    """
    for i in range(3):
        ahead.at[i], ahead.speed[i], ahead.shear[i] = now.at[i], now.speed[i], now.shear[i]
        ahead.turn[i], ahead.rate[i], ahead.bend[i] = now.turn[i], now.rate[i], now.bend[i]
    step(base, up, ahead, force, moment, added, added, dt)
    turn = (now.turn[0], now.turn[1], now.turn[2])
    about = spin(turn, (ahead.turn[0] - turn[0], ahead.turn[1] - turn[1], ahead.turn[2] - turn[2]))
    for i in range(3):
        expected[i], expected[3 + i] = ahead.at[i] - now.at[i], about[i]
    k, c, b = base.shear_stiffness, base.shear_damping, base.footprint
    flat, disc = 0.25 * b * b, 0.5 * b * b
    normal, rubs, bears = math.inf, math.inf, 1.0
    if not base.attached:
        at, v = (ahead.at[0], ahead.at[1], ahead.at[2]), (ahead.speed[0], ahead.speed[1], ahead.speed[2])
        depth = base.weight / base.stiffness - dot(at, up)
        normal = max(base.stiffness * depth - base.damping * dot(v, up), 0.0) if depth > 0.0 else 0.0
        rubs, bears = base.friction * normal, min(normal / base.weight, 1.0)
    shear = (ahead.shear[0], ahead.shear[1], ahead.shear[2])
    twist, tilt = parts((ahead.bend[0], ahead.bend[1], ahead.bend[2]), up)
    mass, inertia = base.mass + added[0], base.inertia + added[1]
    bears_more = base.attached or (pressed and normal > 0.0)
    along = _yields(mass, base.stiffness, base.damping, 0.0, 1.0 if bears_more else 0.0, 1.0 if bears_more else 0.0, dt)
    across = _yields(mass, k, c, math.sqrt(dot(shear, shear)), rubs, bears, dt)
    leans = _yields(
        inertia, flat * base.stiffness, flat * base.damping, math.sqrt(dot(tilt, tilt)), normal * b, bears, dt
    )
    winds = _yields(inertia, disc * k, disc * c, abs(twist), 2.0 / 3.0 * b * rubs, bears, dt)
    _along(up, along, across, mobility, 0)
    _along(up, winds, leans, mobility, 3)
    _turn(turn, mobility, 3)
