"""Closed forms, and formulas over whole paths, that tests hold the formulas of palpate against."""

import math

import numpy as np

from palpate.physics.contact.series import kernel_form, series, series_step
from palpate.physics.contact.terminal import Terminal
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.stability import held
from palpate.physics.display import hertz_surface as hertz
from palpate.physics.friction import bristle
from palpate.physics.friction.lugre import stribeck
from palpate.physics.geometry import nurbs_fit
from palpate.physics.materials.voigt import chain_strain_step

PLANE_INTEGRALS = (math.pi / 3, math.pi / 7, math.pi * (0.5 - 2 / math.pi**2))
"""Of each kernel that spreads a load, in units of R²."""


def static_split(approach, finger, body_stiffness, body_exponent):
    """Force [N] and the shares s1, s2 [m] of the approach [m] (...) at rest, body g2 = K s^n."""
    e = np.asarray(approach, float)
    body = Terminal(body_stiffness, body_exponent)
    rows = np.array([series(x, math.inf, 0.0, finger, 0.0, body) for x in e.ravel()]).reshape(*e.shape, 3)
    return rows[..., 0], rows[..., 1], rows[..., 2]


def series_path(approach, dt, finger, finger_damping, body_stiffness, body_exponent, body_damping):
    """Force [N], s1 and s2 [m], each (k), along a path of approaches [m] (k), from rest, body g2 = K s^n.

    dt  [s]  () or (k)  length of each step
    """
    e, steps = np.broadcast_arrays(np.asarray(approach, dtype=float), np.asarray(dt, dtype=float))
    form, body = kernel_form(finger, finger_damping), (float(body_stiffness), float(body_exponent), float(body_damping))
    rows, s1, s2 = [], 0.0, 0.0
    for at, step in zip(e.tolist(), steps.tolist(), strict=True):
        f, s1, s2 = series_step(at, step, s1, form, *body, 0.0, s2)
        rows.append((f, s1, s2))
    return np.array(rows).T


def angles_of(encoder, falcon=FALCON):
    """Driven angles [rad] (...) of encoder counts [1] (...): zero + counts * count."""
    return falcon.zero + np.asarray(encoder) * falcon.count


def wall_damping(stiffness, damping, period):
    """Device damping above which a sampled wall without delay or filter is passive, b > K T/2 + |B| [N s/m].

    stiffness  [N/m]    K of the wall
    damping    [N s/m]  B of the wall, from the backward difference; its sign does not matter
    period     [s]      T of the samples
    """
    return stiffness * period / 2.0 + abs(damping)


def delayed_damping(stiffness, period, delay):
    """The same for a pure spring behind `delay` whole samples, b > K T (1/2 + d) [N s/m]."""
    return stiffness * period * (0.5 + delay)


def jury_stiffness(mass, drag, period):
    """The same in closed form for a spring alone without delay, from Jury's conditions on z² - tr z + det:

    det < 1:           K < (1 - p)/(a q - p c)
    1 + tr + det > 0:  K < 2 (1 + p)/(c (1 + p) - a q)   where that is positive
    """
    a, p, c, q = held(mass, drag, period)
    bounds = [(1.0 - p) / (a * q - p * c)]
    if (below := c * (1.0 + p) - a * q) > 0.0:
        bounds.append(2.0 * (1.0 + p) / below)
    return min(bounds)


def tissue_displacement(r, contact):
    """u_t(r) [m], by which the tissue's surface is pressed in; inside the contact u_f + u_t = delta - r²/(2R)."""
    return hertz.displacement(r, contact.radius, contact.curvature, 1.0 - contact.share)


def steady_friction(speed, law):
    """Coefficient of friction [1] (...) in steady sliding at `speed` [m/s] (...): g(v) + sigma2 v."""
    v = np.abs(np.asarray(speed, float))
    g = [stribeck(s, law.mu_slide, law.mu_static, law.stribeck) for s in v.ravel()]
    return np.reshape(g, v.shape) + law.viscous * v


def stress_history(time, strain, moduli, viscosities, shares=None):
    """Stress [Pa] (n) of a Voigt chain that starts at rest at time[0] [s] and follows a strain history [1] (n); shares
    of its elements None: all alike."""
    moduli, viscosities = np.atleast_1d(np.asarray(moduli, float)), np.atleast_1d(np.asarray(viscosities, float))
    shares = np.full(moduli.shape, 1.0 / moduli.size) if shares is None else np.atleast_1d(np.asarray(shares, float))
    strains, stress = np.zeros(moduli.size), np.zeros(len(time))
    for k in range(1, len(time)):
        stress[k] = chain_strain_step(strains, moduli, viscosities, shares, strain[k], time[k] - time[k - 1])
    return stress


def bristle_path(law, slip, load, dt, normal=(0.0, 0.0, 1.0)):
    """Force [N] (k,3), deflection [m] (k,3) and stick flag (k) along a path, from rest.

    slip    [m/s] (k,3)         velocity of the finger; its part along the normal is left out
    load    [N]   () or (k)     normal force
    dt      [s]   () or (k)     length of each step, > 0
    normal  [1]   (3) or (k,3)  unit normals
    """
    v = np.atleast_2d(np.asarray(slip, float))
    force, deflection, stick = np.empty_like(v), np.empty_like(v), np.empty(len(v), bool)
    loads, steps = np.broadcast_to(load, len(v)), np.broadcast_to(dt, len(v))
    normals = np.broadcast_to(np.asarray(normal, float), v.shape)
    kernel, bristles = bristle.kernel_form(law), bristle.Bristles()
    for i in range(len(v)):
        n, u = tuple(normals[i].tolist()), tuple(v[i].tolist())
        bristles, force[i], stick[i] = bristle.step(kernel, bristles, n, u, float(loads[i]), float(steps[i]))
        deflection[i] = bristles.z
    return force, deflection, stick


def torus(major: float, minor: float):
    """The exact torus [m] round the z axis; u goes round the axis, v round the tube.

    ValueError: minor >= major, where the tube meets itself.
    """
    if not 0 < minor < major:
        raise ValueError(f"minor radius: found {minor}, expected between 0 and the major radius {major}")
    circle, weights, knots = nurbs_fit._arc(4)
    return nurbs_fit._revolved(major + minor * circle[:, 0], minor * circle[:, 1], weights, knots, True)


def decays(path: np.ndarray) -> bool:
    """Whether a linear swing dies down: less of it in the last eighth of places [m] (k) than in the second."""
    if not np.isfinite(path).all():
        return False
    parts = np.array_split(path, 8)
    return float(np.ptp(parts[-1])) < float(np.ptp(parts[1]))
