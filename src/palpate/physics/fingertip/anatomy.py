"""An adult index fingertip in closed form: the reference shape for tests of scans, and the default of the nodes.

Cross-sections are pairs of half ellipses (palmar and dorsal) whose axes vary along the finger; both the finger and the
bone end in an ellipsoidal cap:

    (x - x0)^2 / a(y)^2 + (z - z0)^2 / b(y)^2 + <1 - (y - y0)/l>^2 = 1,        b palmar below z0, dorsal above

All axes of the inner border of the skin are shorter by the skin's thickness. Dimensions are rounded values typical of
adult index fingers.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.compiler.exact import exp
from palpate.physics.arrays import Numbers
from palpate.physics.fingertip.surfaces import FingertipSurfaces


@dataclass(frozen=True)
class Anatomy:
    """Dimensions [m] of a fingertip.

    length     from the tip to where the model ends          cap     length of the rounded tip
    """

    length: float = 0.028
    width: float = 0.016  # of the finger
    palmar: float = 0.0052  # from the axis to the pulp
    bulge: float = 0.0022  # of the pulp, in addition to `palmar`
    dorsal: float = 0.0053  # from the axis to the nail
    cap: float = 0.009
    skin: float = 0.0011  # thickness
    bone_start: float = 0.0045  # from the tip to the bone
    bone_cap: float = 0.0025  # length of its rounded end
    shaft: float = 0.0025  # half width of the bone's shaft
    tuft: float = 0.0012  # added by its tuft
    bone_depth: float = 0.0020  # half depth of the shaft
    bone_height: float = 0.0004  # of the bone's axis above the finger's
    bone_shift: float = 0.0006  # lateral, of the bone's axis (+x)

    def axes(self, name: str, y: Numbers) -> tuple[Any, ...]:
        """Half width, palmar and dorsal half depth, start and cap length of a surface at y [m] (...)."""
        y = np.asarray(y, float)
        if name == "bone":
            tuft = exp(-(((y - self.bone_start - 2e-3) / 2.5e-3) ** 2))
            base = np.clip((y - 0.014) / 0.009, 0, 1)
            base = base * base * (3 - 2 * base)
            depth = self.bone_depth * (1 + 0.15 * tuft + 0.5 * base)
            return self.shaft + self.tuft * tuft + 1.1 * self.shaft * base, depth, depth, self.bone_start, self.bone_cap
        less = self.skin if name == "tissue" else 0.0
        palmar = self.palmar + self.bulge * exp(-(((y - self.cap) / 9e-3) ** 2))
        ones = np.ones_like(y)
        return ones * (self.width / 2 - less), palmar - less, ones * (self.dorsal - less), less, self.cap - less

    def level(self, name: str, points: Numbers) -> np.ndarray:
        """Approximate signed distance [m] (...) to a surface, exactly zero on it; arguments as of
        `FingertipSurfaces.level`."""
        x, y, z = np.moveaxis(np.asarray(points, float), -1, 0)
        if name == "bone":
            x, z = x - self.bone_shift, z - self.bone_height
        a, palmar, dorsal, start, cap = self.axes(name, y)
        b = np.where(z < 0, palmar, dorsal)
        ahead = np.maximum(1 - (y - start) / cap, 0)
        size = np.sqrt((x / a) ** 2 + (z / b) ** 2 + ahead**2)
        slope = np.sqrt((x / a**2) ** 2 + (z / b**2) ** 2 + (ahead / cap) ** 2) / np.maximum(size, 1e-12)
        return (size - 1) / np.clip(slope, 1 / np.maximum(np.maximum(a, b), cap), 1 / np.minimum(np.minimum(a, b), cap))

    def fingertip(self, spacing: float = 4e-4) -> FingertipSurfaces:
        """The surfaces sampled on a grid of this spacing [m], with a margin of 2 mm round the finger."""
        margin = 2e-3
        low = np.array([-self.width / 2 - margin, -margin, -self.palmar - self.bulge - margin])
        high = np.array([self.width / 2 + margin, self.length, self.dorsal + margin])
        count = np.ceil((high - low) / spacing).astype(int) + 1
        grid = np.stack(
            np.meshgrid(*(a + spacing * np.arange(n) for a, n in zip(low, count, strict=True)), indexing="ij"), -1
        )
        return FingertipSurfaces(low, np.full(3, spacing), *(self.level(k, grid) for k in ("skin", "tissue", "bone")))
