"""Forward sensitivity of bristle friction by the load that it bears.

Any law of `physics.friction` is a step (z, last load, load) -> (z+, force), smooth but at the switches of its energy
rule. Its derivative along a direction is a central difference of that step alone, by `STEP` of load and deflection:
off by some 1e-9 of itself.
"""

import numpy as np

from palpate.physics.friction import bristle
from palpate.physics.friction.bristle import Bristles, Vector

STEP = 1e-5


class FrictionTangent:
    """Derivatives of deflection and force by each of `count` parameters, at a given motion of the finger."""

    def __init__(self, kernel: bristle.Kernel, count: int) -> None:
        self.kernel, self.before = kernel, Bristles()
        self.dz, self.dload = np.zeros((count, 3)), np.zeros(count)

    def step(
        self, deflection: Vector, normal: Vector, slip: Vector, load: float, dt: float, dload: np.ndarray
    ) -> np.ndarray:
        """(P,3) Derivatives of the tangential force [N] of a step that came out at `deflection` [m] (3); the load [N]
        has the derivatives `dload` (P,)."""
        after, force = np.zeros_like(self.dz), np.zeros_like(self.dz)
        if load > 0.0:
            for p, along in enumerate(dload.tolist()):
                after[p], force[p] = self._along(p, normal, slip, load, dt, along)
            self.before = Bristles(deflection, normal, load)
        else:
            self.before = Bristles()
        self.dz, self.dload = after, dload.copy()
        return force

    def _along(
        self, p: int, normal: Vector, slip: Vector, load: float, dt: float, dload: float
    ) -> tuple[np.ndarray, np.ndarray]:
        z, last = np.array(self.before.z), self.before.load
        size = max(
            abs(dload) / load,
            abs(self.dload[p]) / last if last > 0.0 else 0.0,
            float(np.abs(self.dz[p]).max()) / max(float(np.abs(z).max()), 1e-9),
        )
        if size == 0.0:
            return np.zeros(3), np.zeros(3)
        h = STEP / size
        ends = []
        for side in (h, -h):
            before = Bristles(
                tuple((z + side * self.dz[p]).tolist()),
                self.before.normal,
                max(last + side * float(self.dload[p]), 0.0),
            )
            bristles, force, _ = bristle.step(self.kernel, before, normal, slip, load + side * dload, dt)
            ends.append((np.array(bristles.z), np.array(force)))
        return (ends[0][0] - ends[1][0]) / (2.0 * h), (ends[0][1] - ends[1][1]) / (2.0 * h)
