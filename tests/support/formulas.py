"""Closed forms, and formulas for whole paths, with which tests compare the formulas of palpate."""

import math
from dataclasses import replace

import bristles as bristle
import numpy as np

from palpate.physics.contact.series import elastic, kernel_form, series_step
from palpate.physics.contact.terminal import Terminal
from palpate.physics.device.falcon import FALCON
from palpate.physics.device.stability import hold_step
from palpate.physics.display.shape_display import pad_displacement
from palpate.physics.fingertip.beam_bundle import bundle, check_count
from palpate.physics.friction.lugre import stribeck
from palpate.physics.geometry import nurbs_fit
from palpate.physics.geometry.nurbs import NurbsPatch, normal_of
from palpate.physics.materials.voigt import TISSUE, chain_strain_step

PLANE_INTEGRALS = (math.pi / 3, math.pi / 7, math.pi * (0.5 - 2 / math.pi**2), 2 * math.pi / 3)
"""Plane integral of each kernel that spreads a load [R²]."""


def force(law, s, rate=0.0, damping=0.0):
    """Force g(s) <1 + c s'> [N] of an elastic law at compressions s [m] and their rates [m/s] (...)."""
    depth, speed = np.broadcast_arrays(np.asarray(s, float), np.asarray(rate, float))
    pairs = zip(depth.ravel().tolist(), speed.ravel().tolist(), strict=True)
    forces = [elastic(x, *law)[0] * max(0.0, 1.0 + damping * v) for x, v in pairs]
    return np.array(forces).reshape(depth.shape)


def series(approach, dt, compression, finger, finger_damping, body):
    """One step of fingertip and body in series, see `series_step`: (f, s1, s2) [N, m, m]."""
    form = kernel_form(finger, finger_damping)
    return series_step(float(approach), float(dt), float(compression), form, *map(float, body))


def pad_pressure(r, contact):
    """Contact pressure [Pa] of a fingerpad at r [m] (...): Hertz's (K. L. Johnson, Contact Mechanics (1985), 3.39)."""
    inside = np.maximum(np.square(contact.radius) - np.square(r), 0.0)
    return 2.0 * contact.modulus * contact.curvature / np.pi * np.sqrt(inside)


def foot_row(foot):
    """Point, normal, place, distance and triangle (10) of a foot."""
    return np.array([*foot.point, *foot.normal, *foot.place, foot.distance, foot.triangle])


def outward_normal(surface, u, v):
    """Outward unit normal [1] (...,3) of a NURBS patch, at a pole the limit."""
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    derivatives = surface.derivatives(u, v).reshape(-1, 6, 3)
    rows = zip(u.ravel().tolist(), v.ravel().tolist(), derivatives, strict=True)
    return np.array([normal_of(*surface.packed[:2], x, y, d) for x, y, d in rows]).reshape(*u.shape, 3)


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
    a, p, c, q = hold_step(mass, drag, period)
    bounds = [(1.0 - p) / (a * q - p * c)]
    if (below := c * (1.0 + p) - a * q) > 0.0:
        bounds.append(2.0 * (1.0 + p) / below)
    return min(bounds)


def tissue_displacement(r, contact):
    """Displacement u_t(r) [m] of the tissue's surface; inside the contact u_f + u_t = delta - r²/(2R)."""
    return pad_displacement(r, contact._replace(share=1.0 - contact.share))


def steady_friction(speed, law):
    """Coefficient of friction [1] (...) in steady sliding at `speed` [m/s] (...): g(v) + sigma2 v."""
    v = np.abs(np.asarray(speed, float))
    g = [stribeck(s, law.mu_slide, law.mu_static, law.stribeck) for s in v.ravel()]
    return np.reshape(g, v.shape) + law.viscous * v


def stress_history(time, strain, moduli, viscosities, shares=None):
    """Stress [Pa] (n) of a Voigt chain that starts at rest at time[0] [s] and follows a strain history [1] (n). Shares
    of its elements None: equal."""
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
    """The exact torus [m] around the z axis; u is the angle around the axis, v around the tube.

    ValueError: minor >= major, so that the tube intersects itself.
    """
    if not 0 < minor < major:
        raise ValueError(f"minor radius: found {minor}, expected between 0 and the major radius {major}")
    circle, weights, knots = nurbs_fit._arc(4)
    tube = nurbs_fit._revolve_profile(major + minor * circle[:, 0], minor * circle[:, 1], weights, knots)
    return replace(tube, closed_v=True)


def decays(path: np.ndarray) -> bool:
    """Whether a linear oscillation decays: its amplitude in the last 1/8 of positions [m] (k) is below that in the
    second."""
    if not np.isfinite(path).all():
        return False
    parts = np.array_split(path, 8)
    return float(np.ptp(parts[-1])) < float(np.ptp(parts[1]))


def dome(radius, length, pitch, depth, material=TISSUE, **more):
    """A paraboloid of the given radius [m] on beams of one length [m] and one material, meshed to a depth [m].

    Without relaxation and sheet it has closed forms: F_n = (E / L) pi R d^2, and F_t / (mu F_n) = 1 - (1 - s/s_g)^2
    with s_g = 2 (1 + nu) mu d. `more` as in `bundle`.
    """
    check_count(2 * math.pi * radius * depth / pitch**2)
    n = int(math.sqrt(2 * radius * depth) / pitch) + 2
    index = np.stack(np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1), indexing="ij"), -1).reshape(-1, 2)
    heights = (index**2).sum(axis=1) * pitch**2 / (2 * radius)
    touches = heights < depth
    index, heights = index[touches], heights[touches]
    return bundle(index, pitch, heights, np.full((len(index), 1), length), (material,), **more)


def anatomy_volume(shape, name, until):
    """Volume [m³] inside a closed surface from the tip to `until` [m], from palmar and dorsal half ellipses."""
    y = np.linspace(0, until, 20001)
    a, palmar, dorsal, start, cap = shape.axes(name, y)
    ahead = np.maximum(1 - (y - start) / cap, 0)
    return float(np.trapezoid(np.pi / 2 * a * (palmar + dorsal) * np.maximum(1 - ahead**2, 0), y))


def bspline(control, closed_u=False, closed_v=False):
    """The bicubic B-spline patch of control points [m] (n,m,3), uniform knots; a closed direction wraps."""
    knots = []
    for axis, closed in enumerate((closed_u, closed_v)):
        n = control.shape[axis]
        if closed:
            control = np.concatenate([control, np.take(control, range(3), axis=axis)], axis=axis)
            knots.append((np.arange(n + 7) - 3.0) / n)
        else:
            knots.append(np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, n - 2), np.ones(3)]))
    return NurbsPatch(control, np.ones(control.shape[:2]), *knots, 3, 3, closed_u, closed_v)
