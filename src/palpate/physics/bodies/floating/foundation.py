"""A rigid organ with six freedoms on a foundation of springs and dampers, moved by what touches it.

With the displacement d [m] (3) of the centre of mass from rest, the rotation vector r [rad] (3), the unit vector u out
of the foundation, and the force F [N] (3) and moment Q [N m] (3) of all fingers on the organ of mass m [kg] and radius
of gyration g [m], with v = d' and w = r',

    m v' = F + (N - W) u - S,    m g² w' = Q - B - D

    N   along u, normal      K [N/m], C [N s/m]
    S   across u, shear      k, c
    B   across u, tilt       K b²/4, C b²/4         of springs per area of the disc of radius b [m] on which it lies
    D   along u, twist       k b²/2, c b²/2

Q is the moment that works on r (`turning`); the inertia is that of a sphere, so m g² is one number. An attached organ
is held by N = W - K d.u - C v.u, and by a spring and a damper for each of S, B, D. A loose organ lies on the foundation
by its weight W:

    N = <K <W/K - d.u> - C v.u> where W/K > d.u, else 0;    |S| <= mu N,  |B| <= N b,  |D| <= 2/3 mu N b

with <x> = max(0, x), for their springs, which slip at these limits, and dampers of N/W at most. So it can be lifted
off, turned and dropped, and stays as it lands. |B| is largest where the rim of the disc bears all, |D| where all of it
slips.

A step is implicit Euler in the foundation, with closed forms for each case, so that for any T, stiffness and mass, with
the springs' elongations e,

    H = (m + a) |v|²/2 + (m g² + a_r) |w|²/2 + K <W/K - d.u>²/2 + W d.u + sum of k |e|²/2,    dH <= F.dd + Q.dr

(attached: K (d.u)²/2 in place of the third and fourth term). a and a_r: `added_inertia`.

Errors: the foundation of first order in T, a numerical damping ratio of f T/2 at the angular frequency f. The inertia
is that of r, not of the angular velocity: equal to |r|²/12. The moment of S about the centre is neglected.

J. C. Simo, T. J. R. Hughes, Computational Inelasticity (Springer 1998): return mapping. J. J. Moreau, in: Nonsmooth
Mechanics and Applications (Springer 1988) 1-82: implicit steps of unilateral contact. E. Winkler, Die Lehre
von der Elasticitaet und Festigkeit (Dominicus, Prague 1867): springs per area.
"""

import math
from typing import NamedTuple

from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Record, Vector3
from palpate.physics.bodies.floating.added_inertia import kept


class Constants(NamedTuple):
    """Constants of an organ and its foundation, see above."""

    mass: float  # [kg] m > 0
    inertia: float  # [kg m²] m g² > 0
    weight: float  # [N] W > 0 of a loose organ, else 0
    stiffness: float  # [N/m] K > 0
    damping: float  # [N s/m] C >= 0
    shear_stiffness: float  # [N/m] k > 0
    shear_damping: float  # [N s/m] c >= 0
    footprint: float  # [m] b > 0
    friction: float  # [1] mu >= 0 of a loose organ
    attached: bool


FIELDS = {name: bool if name == "attached" else () for name in Constants._fields}
"""Form of a record with these constants."""
MOTION = {"at": (3,), "speed": (3,), "shear": (3,), "turn": (3,), "rate": (3,), "bend": (3,)}
"""d, v; elongation of S [m]; r, w; elongation of B and D [rad]."""


@kernel
def normal_step(base: Record, inertia: float, push: float, at: float, speed: float, dt: float):
    """Velocity v.u [m/s] at the end of the step, and N [N].

    inertia [kg] m + a;  push [N] F.u;  at [m], speed [m/s]  d.u and v.u at its start
    """
    k, c = base.stiffness, base.damping
    depth = base.weight / k - at
    driven = inertia * speed + dt * (push - base.weight)
    v = (driven + dt * k * depth) / (inertia + dt * (c + dt * k))
    normal = k * (depth - dt * v) - c * v
    if base.attached or (depth - dt * v > 0.0 and normal > 0.0):
        return v, normal
    v = driven / inertia  # off the foundation
    if depth - dt * v <= 0.0 or k * (depth - dt * v) - c * v <= 0.0:
        return v, 0.0
    return depth / dt, max((inertia * depth / dt - driven) / dt, 0.0)  # it lands at the end of the step


@kernel
def slipping_step(
    inertia: float, k: float, c: float, limit: float, push: Vector3, stretch: Vector3, speed: Vector3, dt: float
):
    """Velocity and elongation (3) at the end of a step against a spring k that slips at the force `limit`, and a damper
    c; units as those of a displacement or of a rotation.

    inertia  with what is added;  push  force (3);  stretch, speed  elongation and velocity (3) at its start
    """
    drag, pull = inertia + dt * c, dt * k
    x, y, z = inertia * speed[0] + dt * push[0], inertia * speed[1] + dt * push[1], inertia * speed[2] + dt * push[2]
    spring = drag + dt * pull
    v = ((x - pull * stretch[0]) / spring, (y - pull * stretch[1]) / spring, (z - pull * stretch[2]) / spring)
    e = (stretch[0] + dt * v[0], stretch[1] + dt * v[1], stretch[2] + dt * v[2])
    if k * math.sqrt(dot(e, e)) <= limit:
        return v, e
    # it slips, with the force along the elongation of a step without spring
    wx, wy, wz = stretch[0] + dt * x / drag, stretch[1] + dt * y / drag, stretch[2] + dt * z / drag
    share = limit / math.sqrt(wx * wx + wy * wy + wz * wz)
    wx, wy, wz = share * wx, share * wy, share * wz
    return ((x - dt * wx) / drag, (y - dt * wy) / drag, (z - dt * wz) / drag), (wx / k, wy / k, wz / k)


@kernel
def parts(vector: Vector3, up: Vector3):
    """The part of a vector along u, a number, and that across it (3)."""
    along = dot(vector, up)
    return along, (vector[0] - along * up[0], vector[1] - along * up[1], vector[2] - along * up[2])


@kernel
def scaled(share: float, vector: Vector3):
    """A vector (3) times a number."""
    return share * vector[0], share * vector[1], share * vector[2]


@kernel
def plus(a: Vector3, b: Vector3):
    """a + b (3)."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@kernel
def step(
    base: Record, up: Vector3, now: Record, force: Vector3, moment: Vector3, before: Vector3, added: Vector3, dt: float
):
    """Move an organ, in the state `now` (MOTION), by a step of T = `dt` [s] > 0.

    up (3) unit vector u;  force F [N] (3), moment Q [N m] (3)  in the step
    before, added (2)  a [kg] and a_r [kg m²] of the last step and of this one
    """
    # centre of mass
    inertia, share = base.mass + added[0], kept(base.mass, before[0], added[0])
    v = (share * now.speed[0], share * now.speed[1], share * now.speed[2])
    push, aside = parts(force, up)
    rise, drift = parts(v, up)
    at = (now.at[0], now.at[1], now.at[2])
    rise, normal = normal_step(base, inertia, push, dot(at, up), rise, dt)
    k, c, most, b = base.shear_stiffness, base.shear_damping, math.inf, base.footprint
    rubs = rims = twists = most
    bears = 1.0
    if not base.attached:
        bears = min(normal / base.weight, 1.0)
        rubs, rims, twists = base.friction * normal, normal * b, 2.0 / 3.0 * base.friction * normal * b
    shear = (now.shear[0], now.shear[1], now.shear[2])
    drift, shear = slipping_step(inertia, k, bears * c, rubs, aside, shear, drift, dt)
    v = plus(scaled(rise, up), drift)
    # rotation
    inertia, share = base.inertia + added[1], kept(base.inertia, before[1], added[1])
    w = (share * now.rate[0], share * now.rate[1], share * now.rate[2])
    bend = (now.bend[0], now.bend[1], now.bend[2])
    (spun, tilted), (twist, tilt), (wring, lean) = parts(w, up), parts(bend, up), parts(moment, up)
    flat, disc = 0.25 * b * b, 0.5 * b * b
    tilted, tilt = slipping_step(
        inertia, flat * base.stiffness, bears * flat * base.damping, rims, lean, tilt, tilted, dt
    )  # fmt: skip
    about, wound = slipping_step(
        inertia, disc * k, bears * disc * c, twists, scaled(wring, up), scaled(twist, up), scaled(spun, up), dt
    )  # fmt: skip
    w, bend = plus(tilted, about), plus(tilt, wound)
    for i in range(3):
        now.speed[i], now.shear[i], now.rate[i], now.bend[i] = v[i], shear[i], w[i], bend[i]
        now.at[i] += dt * v[i]
        now.turn[i] += dt * w[i]


@kernel
def mechanical_energy(base: Record, up: Vector3, now: Record):
    """Kinetic energy and that stored in foundation and weight [J], without added inertia; 0 for an organ at rest."""
    at, v, w = (now.at[0], now.at[1], now.at[2]), now.speed, now.rate
    high, shear = dot(at, up), (now.shear[0], now.shear[1], now.shear[2])
    twist, tilt = parts((now.bend[0], now.bend[1], now.bend[2]), up)
    if base.attached:
        lifted = 0.5 * base.stiffness * high * high
    else:
        rest = base.weight / base.stiffness
        depth = max(rest - high, 0.0)
        lifted = 0.5 * base.stiffness * (depth * depth - rest * rest) + base.weight * high
    moving = base.mass * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    moving += base.inertia * (w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    disc = 0.5 * base.footprint * base.footprint
    turned = disc * (0.5 * base.stiffness * dot(tilt, tilt) + base.shear_stiffness * twist * twist)
    return 0.5 * moving + lifted + 0.5 * (base.shear_stiffness * dot(shear, shear) + turned)
