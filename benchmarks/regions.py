"""What dry friction and an encoder make of a sampled spring: four regions of a plane without units.

    beta = b/(K T)       viscous drag against what sampling puts in       b [N s/m], K [N/m], T [s]
    sigma = f_c/(K d)    dry friction against what the encoder puts in    f_c [N], d [m] step of the position

beta >= 1/2 and sigma >= 1/2: passive (J. J. Abbott, A. M. Okamura, IEEE Trans. Robotics 21, 2005, 952-964). Else drag
and dry friction may share the work, by how fast the device moves: N. Diolaiti, G. Niemeyer, F. Barbagli, J. K.
Salisbury, IEEE Trans. Robotics 22 (2006) 256-268 part the plane into rest from anywhere, rest from near by only, a
swing that is kept, and one that grows. Here the regions come from simulation, and the lines at 1/2 are drawn over them.
"""

import numpy as np

from palpate.physics.device.wall_loop import WallDevice, run

REST, NEAR, CYCLE, GROWS = "rests", "rests from near by", "swings on", "grows"
KINDS = (REST, NEAR, CYCLE, GROWS)
SECONDS = 10.0
NEARBY, FARAWAY = 2.5, 200.0
"""[1] Steps of the position from which the device is let go."""


def fate(device: WallDevice, stiffness: float, period: float, begin: float) -> str:
    """`REST`, `CYCLE` or `GROWS`: what becomes of a device that is let go `begin` [m] away on a spring [N/m] that never
    lets go, sampled at each period [s]."""
    steps = np.full(round(SECONDS / period), period)
    free = device._replace(limit=1e12, slew=1e15)
    path = run(free, stiffness, 0.0, controlled=False, steps=steps, free=True, begin=begin)[:, 0]
    if not np.isfinite(path).all():
        return GROWS
    parts = np.array_split(path, 8)
    early, late = float(np.ptp(parts[1])), float(np.ptp(parts[-1]))
    if late <= 0.05 * device.resolution:
        return REST
    if late > max(1.02 * early, 4.0 * device.resolution):
        return GROWS
    return CYCLE


def region(device: WallDevice, stiffness: float, period: float) -> str:
    """One of `KINDS`: what becomes of it from near by and from far away."""
    near, far = (fate(device, stiffness, period, n * device.resolution) for n in (NEARBY, FARAWAY))
    if near == far:
        return near
    return NEAR if near == REST and far == GROWS else CYCLE if GROWS not in (near, far) else GROWS


def plane(device: WallDevice, stiffness: float, period: float, beta: np.ndarray, sigma: np.ndarray) -> list[list[str]]:
    """The region at each sigma (rows) and beta (columns), of a device with this mass and resolution."""

    def at(b: float, s: float) -> str:
        drag, coulomb = b * stiffness * period, s * stiffness * device.resolution
        return region(device._replace(drag=drag, coulomb=coulomb), stiffness, period)

    return [[at(b, s) for b in beta.tolist()] for s in sigma.tolist()]
