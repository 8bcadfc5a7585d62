"""The kernels of the Falcon and of its grip for arrays."""

import numpy as np

from palpate.physics.device.falcon import FALCON, HOME, forward_kernel, leg, links
from palpate.physics.device.falcon_statics import force_kernel, torque_kernel
from palpate.physics.device.grip import propagator

GEOMETRY = FALCON.geometry


def inverse(position):
    """Angles t1, t2, t3 [rad] (...,3,3) of each leg at positions [m] (...,3), zeros out of reach; the reach (...)."""
    points = np.asarray(position, dtype=float)
    angles, reach = np.zeros((*points.shape[:-1], 3, 3)), np.zeros(points.shape[:-1], dtype=bool)
    for index in np.ndindex(points.shape[:-1]):
        legs = [leg(GEOMETRY, i, *points[index]) for i in range(3)]
        reach[index] = all(f[0] for f in legs)
        if reach[index]:
            angles[index] = [f[1:] for f in legs]
    return angles, reach


def rates(position):
    """Jacobian [rad/m] (3,3) of the driven angles at a position [m] (3)."""
    _, _, n0, n1, n2, levers = links(GEOMETRY, *map(float, position))
    return np.array([n0, n1, n2]) / np.array(levers)[:, None]


def forward(angles, start=HOME):
    """Position [m] (3) at driven angles [rad] (3), and whether Newton's method from `start` converged."""
    ok, *point = forward_kernel(GEOMETRY, *map(float, angles), *map(float, start))
    return np.array(point), bool(ok)


def counts(angles):
    """Encoder counts of driven angles [rad] (...)."""
    return np.rint((np.asarray(angles, dtype=float) - FALCON.zero) / FALCON.count).astype(np.int64)


def torque(force, position):
    """Torques [N m] (3) for a force [N] (3) at a position [m] (3), and whether it is in reach."""
    ok, *torques = torque_kernel(GEOMETRY, *map(float, force), *map(float, position))
    return np.array(torques), bool(ok)


def force(torques, position):
    """Force [N] (3) for torques [N m] (3) at a position [m] (3), and whether it is in reach."""
    ok, *components = force_kernel(GEOMETRY, *map(float, torques), *map(float, position))
    return np.array(components), bool(ok)


def grip_step(position, velocity, force, dt, mass, drag, stiffness=0.0, damping=0.0, target=(0.0, 0.0, 0.0)):
    """Position and velocity of a held grip after a step of constant force towards a target at rest, exactly."""
    e = propagator((drag + damping) / mass, stiffness / mass, dt)
    y, u = np.asarray(position, float) - target, np.asarray(velocity, float) * dt
    a = np.asarray(force, float) / mass * dt * dt
    return target + e[0, 0] * y + e[0, 1] * u + e[0, 2] * a, (e[1, 0] * y + e[1, 1] * u + e[1, 2] * a) / dt
