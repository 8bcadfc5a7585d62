"""The part of the stiffness of independent beams that slots below the patch leave.

A patch with the weights w(x,y) = (1 - (x² + y²)/R²)² shares a force over the beams that it can touch in proportion to
w, and its indentation is the mean of theirs with the weights w. So the stiffness is proportional to

    (integral of w)²/(integral of w²),

without what lies over a slot. Across a slot along x, the integrals of w and w² over x are (1 - y²/R²)^{5/2} and
(1 - y²/R²)^{9/2}. Linear beams have this stiffness, stiffening ones more. A block in full FE, whose parts are not
independent, keeps 0.72, 0.68, 0.61 and 0.44 over grooves 1, 2, 4 and 8 mm wide, with R = 8 mm.
"""

from __future__ import annotations

import numpy as np

POINTS = 2001  # across the patch


def stiffness_left(middles: tuple[float, ...], width: float, radius: float) -> float:
    """Least stiffness over that without slots [1], of a patch of this radius [m] at any distance from slots of a width
    [m] with these middles [m]; 0: it is over nothing else."""
    y = np.linspace(-1.0, 1.0, POINTS)
    far = max(map(abs, middles)) + radius + width
    at = np.arange(-far, far, 0.02 * radius)
    ends = [(middle - at + sense * width) / radius for middle in middles for sense in (-0.5, 0.5)]
    left = []
    for power in (2.5, 4.5):
        part = np.cumsum((1.0 - y * y) ** power)
        over = [np.interp(end, y, part / part[-1]) for end in ends]
        left.append(1.0 - sum(over[1::2]) + sum(over[::2]))
    return float(np.min(left[0] ** 2 / np.maximum(left[1], 1e-12)))
