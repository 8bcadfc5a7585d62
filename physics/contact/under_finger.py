"""Settings of a scene's tissue for a given modulus, with the finger of the scene `kidney`."""

import math

FINGER_RADIUS = 8e-3  # [m]
BASIS_POISSON = 0.45  # [1] Of the shipped basis of deformation.ReducedFE


def under_finger(plane: float) -> dict[str, float]:
    """Settings of `tissue` for a plane-strain modulus E/(1 - nu²) > 0 [Pa]: Hertz's power law for MassSpring,
    `stiffness` 4/3 E/(1 - nu²) sqrt(R) [N/m^1.5] with `exponent` 1.5 [1], and `young` [Pa] for ReducedFE with the
    Poisson's ratio of its basis.

    K. L. Johnson, Contact Mechanics (1985), 4.2.
    """
    stiffness = 4.0 / 3.0 * plane * math.sqrt(FINGER_RADIUS)
    return {"stiffness": stiffness, "exponent": 1.5, "young": plane * (1.0 - BASIS_POISSON**2)}
