"""Friction of the fingertip, load-normalised: LuGre, and Coulomb with an elastic stick.

LuGre (Canudas de Wit, Olsson, Astrom & Lischinsky, IEEE Trans. Autom. Control 40, 1995, 419-425), vectors in the
tangent plane, v = |v|:

    dz/dt = v - sigma0 v z/g(v),    g(v) = mu_c + (mu_s - mu_c) e^{-(v/v_s)²}
    f_t   = f_n (sigma0 z + sigma1 dz/dt + sigma2 v)

z [m] bristle deflection, sigma0 [1/m], sigma1 and sigma2 [s/m], mu [1]; f_t points along the sliding velocity.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

EXPONENTIAL, EULER = 0, 1
"""Ways to update the bristles over a step: exact at constant velocity, or backward Euler."""

Triple = tuple[float, float, float]


class LuGre(NamedTuple):
    """Parameters of the LuGre law.

    mu_slide   [1]    sliding coefficient mu_c > 0
    mu_static  [1]    static coefficient mu_s >= mu_c
    stribeck   [m/s]  v_s > 0
    sigma0     [1/m]  bristle stiffness over normal force, > 0
    sigma1     [s/m]  bristle damping over normal force
    sigma2     [s/m]  viscous friction over normal force
    """

    mu_slide: float
    mu_static: float
    stribeck: float
    sigma0: float
    sigma1: float
    sigma2: float


def passive_sigma2(mu_slide: float, mu_static: float, sigma1: float) -> float:
    """Least sigma2 [s/m] at which LuGre friction under constant load never gives out energy: sigma1 (mu_s - mu_c)/mu_c
    (Barabanov & Ortega, IEEE Trans. Autom. Control 45, 2000, 675-686)."""
    return sigma1 * (mu_static - mu_slide) / mu_slide


def steady_friction(speed: ArrayLike, law: LuGre) -> np.ndarray:
    """Coefficient of friction [1] (...) in steady sliding at `speed` [m/s] (...): g(v) + sigma2 v."""
    v = np.abs(np.asarray(speed, float))
    dip = np.exp(-np.square(v / law.stribeck))
    return law.mu_slide + (law.mu_static - law.mu_slide) * dip + law.sigma2 * v


@njit(cache=True, error_model="numpy")
def turn(zx, zy, zz, ax, ay, az, bx, by, bz):
    """z [m], tangent to the unit normal a, turned with the smallest rotation that takes a to b; length kept.

    For b = -a, where that rotation is not unique, z is the axis and stays.
    """
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    if length == 0.0:
        return 0.0, 0.0, 0.0
    # R z = z - (z.b)/(1 + a.b) (a + b) for z perpendicular to a.
    lean = (zx * bx + zy * by + zz * bz) / max(1.0 + ax * bx + ay * by + az * bz, 1e-12)
    x, y, z = zx - lean * (ax + bx), zy - lean * (ay + by), zz - lean * (az + bz)
    # Take away what rounding, or a normal that is not quite unit, leaves along b.
    lift = x * bx + y * by + z * bz
    x, y, z = x - lift * bx, y - lift * by, z - lift * bz
    rest = math.sqrt(x * x + y * y + z * z)
    if not rest > 0.0:
        return 0.0, 0.0, 0.0
    scale = length / rest
    return x * scale, y * scale, z * scale


@njit(cache=True, error_model="numpy")
def lugre_kernel(state, normal, slip, load, dt, mu_c, mu_s, v_s, sigma0, sigma1, sigma2, update, rescale, out):
    """One step of LuGre friction; returns True while the contact sticks.

    state    (7)       z [m] (3), normal [1] (3) and normal force [N] of the last step; changed in place
    normal   [1] (3)   unit normal of this step
    slip     [m/s] (3) velocity of the finger; its part along the normal is left out
    load     [N]       normal force; without load z is forgotten and the force is zero
    dt       [s]       T > 0
    update             0 exact at constant velocity, 1 backward Euler
    rescale            True: scale z by sqrt(f_old/f_new) when the load rises, so that this gives no energy
    out      [N] (3)   the tangential force

    Exact update, a = sigma0 v/g:  z+ = z e^{-aT} + v T phi(aT),  phi(x) = (1 - e^{-x})/x. z+ is a mean of z and of
    the steady z, so |z| <= mu_s/sigma0 for any v and T. The force takes dz/dt as (z+ - z)/T.

    The contact sticks while less than half of the motion is lasting slip: sigma0 z.v/|v| < g(v)/2, or v = 0.
    """
    out[:] = 0.0
    nx, ny, nz = normal[0], normal[1], normal[2]
    if not load > 0.0:
        state[:] = 0.0
        return False
    zx, zy, zz = state[0], state[1], state[2]
    before = state[6]
    if before > 0.0:
        zx, zy, zz = turn(zx, zy, zz, state[3], state[4], state[5], nx, ny, nz)
        if rescale and load > before:
            shrink = math.sqrt(before / load)
            zx, zy, zz = zx * shrink, zy * shrink, zz * shrink
    along = slip[0] * nx + slip[1] * ny + slip[2] * nz
    vx, vy, vz = slip[0] - along * nx, slip[1] - along * ny, slip[2] - along * nz
    v = math.sqrt(vx * vx + vy * vy + vz * vz)
    ratio = v / v_s
    g = mu_c + (mu_s - mu_c) * math.exp(-ratio * ratio)
    x = sigma0 * v / g * dt
    if update == 0:
        keep = math.exp(-x)
        gain = dt * (1.0 - 0.5 * x if x < 1e-5 else -math.expm1(-x) / x)
    else:
        keep = 1.0 / (1.0 + x)
        gain = dt * keep
    ux, uy, uz = zx * keep + vx * gain, zy * keep + vy * gain, zz * keep + vz * gain
    out[0] = load * (sigma0 * ux + sigma1 * (ux - zx) / dt + sigma2 * vx)
    out[1] = load * (sigma0 * uy + sigma1 * (uy - zy) / dt + sigma2 * vy)
    out[2] = load * (sigma0 * uz + sigma1 * (uz - zz) / dt + sigma2 * vz)
    state[0], state[1], state[2] = ux, uy, uz
    state[3], state[4], state[5] = nx, ny, nz
    state[6] = load
    return v == 0.0 or sigma0 * (ux * vx + uy * vy + uz * vz) < 0.5 * g * v


@njit(cache=True, error_model="numpy")
def coulomb_kernel(state, normal, slip, load, dt, mu, stiffness, out):
    """One step of Coulomb friction with an elastic stick; returns True while the contact sticks.

    Return mapping: the trial deflection z + v T of a spring of `stiffness` [N/m] is brought back to the disc
    |k z| <= mu f_n along itself. Exact for a straight path, without chatter, and passive whatever T and load: the
    spring keeps or loses energy. Arguments as in `lugre_kernel`.
    """
    out[:] = 0.0
    nx, ny, nz = normal[0], normal[1], normal[2]
    if not load > 0.0:
        state[:] = 0.0
        return False
    zx, zy, zz = state[0], state[1], state[2]
    if state[6] > 0.0:
        zx, zy, zz = turn(zx, zy, zz, state[3], state[4], state[5], nx, ny, nz)
    along = slip[0] * nx + slip[1] * ny + slip[2] * nz
    zx += (slip[0] - along * nx) * dt
    zy += (slip[1] - along * ny) * dt
    zz += (slip[2] - along * nz) * dt
    length = math.sqrt(zx * zx + zy * zy + zz * zz)
    limit = mu * load / stiffness
    stick = length <= limit
    if not stick:
        scale = limit / length
        zx, zy, zz = zx * scale, zy * scale, zz * scale
    out[0], out[1], out[2] = stiffness * zx, stiffness * zy, stiffness * zz
    state[0], state[1], state[2] = zx, zy, zz
    state[3], state[4], state[5] = nx, ny, nz
    state[6] = load
    return stick


def lugre_path(
    slip: ArrayLike,
    load: ArrayLike,
    dt: ArrayLike,
    law: LuGre,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    update: int = EXPONENTIAL,
    rescale: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] (k,3) and bristle deflection [m] (k,3) along a path, from rest.

    slip    [m/s] (k,3)         velocity of the finger
    load    [N]   () or (k)     normal force
    dt      [s]   () or (k)     length of each step, > 0
    normal  [1]   (3) or (k,3)  unit normals
    """
    v = np.atleast_2d(np.asarray(slip, float))
    force, bristle = np.empty_like(v), np.empty_like(v)
    loads, steps = np.broadcast_to(load, len(v)), np.broadcast_to(dt, len(v))
    normals = np.ascontiguousarray(np.broadcast_to(np.asarray(normal, float), v.shape))
    state = np.zeros(7)
    for i in range(len(v)):
        lugre_kernel(state, normals[i], v[i], float(loads[i]), float(steps[i]), *law, update, rescale, force[i])
        bristle[i] = state[:3]
    return force, bristle


def coulomb_path(slip: ArrayLike, load: ArrayLike, dt: ArrayLike, mu: float, stiffness: float):
    """Force [N] (k,3), deflection [m] (k,3) and stick flag (k) along a path with normal +z, from rest; arguments as
    in `lugre_path`, `stiffness` [N/m]."""
    v = np.atleast_2d(np.asarray(slip, float))
    force, bristle, stick = np.empty_like(v), np.empty_like(v), np.empty(len(v), bool)
    loads, steps = np.broadcast_to(load, len(v)), np.broadcast_to(dt, len(v))
    state, normal = np.zeros(7), np.array([0.0, 0.0, 1.0])
    for i in range(len(v)):
        stick[i] = coulomb_kernel(state, normal, v[i], float(loads[i]), float(steps[i]), mu, stiffness, force[i])
        bristle[i] = state[:3]
    return force, bristle, stick
