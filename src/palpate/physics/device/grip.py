"""A simulated hand that holds the grip of a device and follows a path.

The grip is a mass with drag; the arm pulls it towards the target p(t) through a spring and a damper:

    m x'' = F - b x' + k (p - x) + c (p' - x')

With y = x - p and p' constant over a step this is linear with a constant right side, so a step with the matrix
exponential is exact and stable for any length.
"""

import math

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import put, vector
from palpate.physics.device.falcon import leg, reachable
from palpate.physics.device.falcon_statics import force_kernel, saturate

GRIP = {
    "mass": (), "drag": (), "stiffness": (), "damping": (),  # m [kg], b [N s/m] of the device; k [N/m], c [N s/m]
    "resolution": (), "limit": (),  # [rad] encoder count, 0: not rounded; [N m] of the motors
}  # fmt: skip
"""Constants of a grip."""
MOTION = {
    "position": (3,), "velocity": (3,), "time": (), "segment": int,  # [m], [m/s], [s]; segment of the path
    "propagator": (3, 3), "length": (),  # the last one, and the length of its step [s]
}  # fmt: skip
"""State of a grip."""
LINEAR, MINIMUM_JERK = 0, 1
SUBSTEP = 1e-3  # [s]
MOST_SUBSTEPS = 1000
LONGEST = 1e6  # [s] upper limit of a step


@kernel
def propagator(rate, frequency2, dt):
    """exp of [[0, 1, 0], [-w2 T^2, -g T, 1], [0, 0, 0]] for y'' + g y' + w2 y = a, on (y, y' T, a T^2).

    rate        [1/s]    g
    frequency2  [1/s^2]  w2
    Taylor series after scaling to a norm below 1/4, then squared back.
    """
    p, q = -frequency2 * dt * dt, -rate * dt
    norm = max(1.0, abs(p) + abs(q) + 1.0)
    halvings = max(0, math.ceil(math.log2(4.0 * norm)))
    scale = 0.5**halvings
    m, term, total = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    m[0, 1], m[1, 0], m[1, 1], m[1, 2] = scale, p * scale, q * scale, scale
    for k in range(3):
        term[k, k] = total[k, k] = 1.0
    for i in range(1, 14):
        term = times(term, m)
        for k in range(3):
            for j in range(3):
                term[k, j] /= i
                total[k, j] += term[k, j]
    for _ in range(halvings):
        total = times(total, total)
    return total


@kernel
def times(p, q):
    """Product of two 3 x 3 matrices in a fixed order of additions."""
    r = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            r[i, j] = p[i, 0] * q[0, j] + p[i, 1] * q[1, j] + p[i, 2] * q[2, j]
    return r


@kernel
def path_point(time, ends, points, shapes):
    """(segment, x, y, z) of the path at a time; the last point after its end.

    ends    [s]  (n)     end of each segment, increasing
    points  [m]  (n+1,3)
    shapes  [1]  (n)     LINEAR or MINIMUM_JERK, s^3 (10 - 15 s + 6 s^2)
    """
    count = len(ends)
    i = 0
    while i < count and time >= ends[i]:
        i += 1
    if i == count:
        return i - 1, points[count, 0], points[count, 1], points[count, 2]
    begin = ends[i - 1] if i > 0 else 0.0
    s = min(max((time - begin) / (ends[i] - begin), 0.0), 1.0)
    if shapes[i] == MINIMUM_JERK:
        s = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    a, b = points[i], points[i + 1]
    return i, a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1]), a[2] + s * (b[2] - a[2])


@kernel
def grip_kernel(geometry, grip, motion, ends, points, shapes, t0, t1, t2, dt):
    """Move the grip of a Falcon by one step under motor torques; returns its driven angles [rad].

    geometry, grip, motion  `falcon.Geometry`, `GRIP`, `MOTION`; the motion is changed in place
    The limit of the legs' reach acts as an end stop: the grip stays at its last position, at rest.
    """
    if 0.0 < dt < math.inf:
        dt = min(dt, LONGEST)
        t0, t1, t2 = saturate(t0, t1, t2, grip.limit)
        count = int(min(max(math.ceil(dt / SUBSTEP - 1e-6), 1), MOST_SUBSTEPS))
        h = dt / count
        mass, drag = grip.mass, grip.drag
        # exact propagator of the linear grip, computed again if the substep changes
        e = motion.propagator
        if motion.length != h:
            made = propagator((drag + grip.damping) / mass, grip.stiffness / mass, h)
            for i in range(9):
                e[i // 3, i % 3] = made[i // 3, i % 3]
            motion.length = h
        # substeps, with the motors' force at the start of each
        begin, position, velocity = motion.time, motion.position, motion.velocity
        _, px, py, pz = path_point(begin, ends, points, shapes)
        for i in range(1, count + 1):
            now = begin + dt * i / count
            segment, qx, qy, qz = path_point(now, ends, points, shapes)
            x, y, z = position[0], position[1], position[2]
            _, fx, fy, fz = force_kernel(geometry, t0, t1, t2, x, y, z)
            x, ux = advance(e, h, mass, drag, fx, x, velocity[0], px, qx, grip)
            y, uy = advance(e, h, mass, drag, fy, y, velocity[1], py, qy, grip)
            z, uz = advance(e, h, mass, drag, fz, z, velocity[2], pz, qz, grip)
            if reachable(geometry, x, y, z):
                put(position, (x, y, z))
                put(velocity, (ux, uy, uz))
            else:
                put(velocity, (0.0, 0.0, 0.0))
            px, py, pz = qx, qy, qz
            motion.time, motion.segment = now, segment
    return angles(geometry, grip, motion)


@kernel
def angles(geometry, grip, motion):
    """The driven angles [rad] of a grip as its encoders count them; arguments as of `grip_kernel`."""
    x, y, z = vector(motion.position)
    return (
        encode_angle(geometry, grip.resolution, leg(geometry, 0, x, y, z)[1]),
        encode_angle(geometry, grip.resolution, leg(geometry, 1, x, y, z)[1]),
        encode_angle(geometry, grip.resolution, leg(geometry, 2, x, y, z)[1]),
    )


@kernel
def advance(e, h, mass, drag, force, x, v, p, q, grip):
    """One axis over a step h [s]: (position [m], velocity [m/s]); the target moves from p to q at constant speed."""
    rate = (q - p) / h
    if grip.stiffness == 0.0 and grip.damping == 0.0:
        p, q, rate = 0.0, 0.0, 0.0  # no hand holds the grip
    y, u, a = x - p, (v - rate) * h, (force - drag * rate) / mass * h * h
    return (q + e[0, 0] * y + e[0, 1] * u + e[0, 2] * a, rate + (e[1, 0] * y + e[1, 1] * u + e[1, 2] * a) / h)


@kernel
def encode_angle(geometry, resolution, angle):
    """The angle [rad] in whole encoder counts of `resolution` [rad] from the encoder's zero; unrounded for 0."""
    if resolution == 0.0:
        return angle
    return geometry.zero + resolution * np.rint((angle - geometry.zero) / resolution)
