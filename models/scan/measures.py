"""The dimensions of a reconstructed fingertip, for the user to check."""

import math
from typing import Any

import numpy as np

from palpate.models.scan.align import FingerFrame
from palpate.models.scan.stack import Stack
from palpate.physics.fingertip.surfaces import FingertipSurfaces, cast, fill


def measures(tip: FingertipSurfaces, depth: float = 2e-3, pitch: float = 1.2e-3) -> dict[str, float]:
    """Sizes [mm], volumes [mm³], and the number of beams in contact with a plate at a depth [m]."""
    inside = np.argwhere(tip.skin < 0)
    size = (np.ptp(inside, axis=0) + 1) * tip.spacing * 1e3
    x, y = np.meshgrid(*(tip.origin[k] + tip.spacing[k] * np.arange(tip.skin.shape[k]) for k in (0, 1)))
    rays = cast(tip, x, y)
    return {
        "breadth_mm": float(size[0]),
        "length_mm": float(size[1]),
        "depth_mm": float(size[2]),
        "skin_mm": float(np.nanmedian(rays.inner - rays.bottom) * 1e3),
        "soft_volume_mm3": (tip.volume("skin") - tip.volume("bone")) * 1e9,
        "bone_volume_mm3": tip.volume("bone") * 1e9,
        "beams": len(fill(tip, depth, pitch).heights),
    }


def of_images(stack: Stack, frame: FingerFrame) -> dict[str, Any]:
    """Number and spacing of the slices, orientation of the finger, and source of the handedness."""
    return {
        "slices": len(stack.volume),
        "spacing_mm": [s * 1e3 for s in stack.spacing],
        "tilt_deg": math.degrees(frame.tilt),
        "roll_deg": math.degrees(frame.roll),
        "left_and_right": {"header": "by the header", "stated": "as stated"}.get(
            stack.handed, "unknown: each slice is assumed to lie behind the previous one (--axes)"
        ),
    }
