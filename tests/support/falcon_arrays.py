"""The Falcon's kinematics and statics for arrays, by the kernels that run in the loop."""

import numpy as np

from palpate.physics.device.falcon import FALCON, HOME, FalconGeometry, forward_kernel, leg, links
from palpate.physics.device.falcon_statics import force_kernel, torque_kernel


def inverse(position, falcon: FalconGeometry = FALCON) -> tuple[np.ndarray, np.ndarray]:
    """Inverse kinematics in closed form: the angles t1, t2, t3 of each leg.

        t3 = acos(v/b)    t1 = atan2(w, X) - acos((rho^2 + a^2 - L^2) / (2 a rho))    X = u + c, rho^2 = X^2 + w^2
        t2 = atan2(w - a sin t1, X - a cos t1)

    position  [m]    (..., 3)     of the grip, device frame
    returns   [rad]  (..., 3, 3)  t1, t2, t3 (last axis) of each leg; zeros where the point is out of reach
              [1]    (...)        whether all legs reach it
    """
    points = np.asarray(position, dtype=float)
    geometry = falcon.geometry
    angles = np.zeros((*points.shape[:-1], 3, 3))
    reach = np.zeros(points.shape[:-1], dtype=bool)
    for index in np.ndindex(points.shape[:-1]):
        legs = [leg(geometry, i, *points[index]) for i in range(3)]
        reach[index] = all(f[0] for f in legs)
        if reach[index]:
            angles[index] = [f[1:] for f in legs]
    return angles, reach


def rates(position, falcon: FalconGeometry = FALCON) -> np.ndarray:
    """The matrix G of the driven angles' rates, rates of t1 = G velocity of the grip.

        a sin(t2 - t1) sin(t3) dt1 = cos(t2) sin(t3) du + cos(t3) dv + sin(t2) sin(t3) dw    for each leg

    position  [m]      (3)    of the grip, device frame
    returns   [rad/m]  (3,3)  one row a leg

    ValueError: out of reach, or a leg is stretched or folded (t1 = t2, t3 = 0 or pi), where G has no bound.
    """
    ok, _, n0, n1, n2, levers = links(falcon.geometry, *map(float, position))
    if not ok:
        raise ValueError(f"position {tuple(map(float, position))} m: out of the Falcon's reach")
    if min(map(abs, levers)) < 1e-9:
        raise ValueError(f"position {tuple(map(float, position))} m: singular, a leg is stretched or folded")
    return np.array([n0, n1, n2]) / np.array(levers)[:, None]


def forward(angles, start=HOME, falcon: FalconGeometry = FALCON) -> tuple[np.ndarray, bool]:
    """Forward kinematics by Newton's method on t1(P) = angles, with G as the derivative.

    Steps of at most 20 mm, halved while they lead out of reach; ends when each angle fits to 1e-9 rad.

    angles   [rad]  (3)  driven angle of each leg
    start    [m]    (3)  where to begin: the last known position
    returns  [m]    (3)  position of the grip, device frame; the last iterate where it failed
             [1]    ()   whether it converged; false for angles that no position has
    """
    ok, *point = forward_kernel(falcon.geometry, *map(float, angles), *map(float, start))
    return np.array(point), bool(ok)


def counts(angles, falcon: FalconGeometry = FALCON) -> np.ndarray:
    """Encoder counts [1] (...) of driven angles [rad] (...): rounded (t1 - zero) / count."""
    return np.rint((np.asarray(angles, dtype=float) - falcon.zero) / falcon.count).astype(np.int64)


def torque(force, position, falcon: FalconGeometry = FALCON) -> tuple[np.ndarray, bool]:
    """Torques that make the grip push with a force, torque = G^-T force.

    Near a singular pose the inverse is damped (least squares), so the torque stays bounded. A torque beyond the
    motors' limit is scaled as a whole vector: the direction of the force is kept.

    force     [N]    (3)  on the hand, device frame
    position  [m]    (3)  of the grip, device frame
    returns   [N m]  (3)  on each arm, at most `falcon.limit`; zero where the position is out of reach
              [1]    ()   whether the position is in reach

    Y. Nakamura, H. Hanafusa, J. Dyn. Syst. Meas. Control 108 (1986) 163-171, for the damped inverse.
    """
    ok, *torques = torque_kernel(falcon.geometry, *map(float, force), *map(float, position))
    return np.array(torques), bool(ok)


def force(torques, position, falcon: FalconGeometry = FALCON) -> tuple[np.ndarray, bool]:
    """Force of the grip on the hand for given torques, force = G^T torques.

    Bounded where a leg is stretched or folded: its lever's inverse grows no further below 1 mm.

    torques   [N m]  (3)  on each arm
    position  [m]    (3)  of the grip, device frame
    returns   [N]    (3)  device frame; zero where the position is out of reach
              [1]    ()   whether the position is in reach
    """
    ok, *components = force_kernel(falcon.geometry, *map(float, torques), *map(float, position))
    return np.array(components), bool(ok)
