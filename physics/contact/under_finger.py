"""Settings of a scene's tissue for a given modulus, with the finger of the scene `kidney`."""

FINGER_RADIUS = 8e-3  # [m]
BASIS_POISSON = 0.45  # [1] Of the shipped basis of deformation.ReducedFE
PATCH = 1.3484  # [1] K/(E/(1 - nu²) R) of deformation.ReducedFE, pressed at the top of the kidney


def under_finger(plane: float) -> dict[str, float]:
    """Settings of `tissue` for a plane-strain modulus E/(1 - nu²) > 0 [Pa] under a patch of R = 8 mm: the linear law of
    MassSpring, `stiffness` 1.35 E/(1 - nu²) R [N/m] with `exponent` 1 [1], and `young` [Pa] for ReducedFE with the
    Poisson's ratio of its basis.

    The factor is that of the kidney on its support, the surface under the patch held sideways (`palpate fit body
    kidney`). On a frictionless half-space the same pressure gives 5 pi/16 = 0.98 (K. L. Johnson, Contact Mechanics
    (1985), 3.4, at the centre).
    """
    return {"stiffness": PATCH * plane * FINGER_RADIUS, "exponent": 1.0, "young": plane * (1.0 - BASIS_POISSON**2)}
