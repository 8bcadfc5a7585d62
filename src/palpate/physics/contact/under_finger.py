"""Settings of a scene's tissue for a given modulus, with the finger of the scene `kidney`."""

from typing import Any

FINGER_RADIUS = 8e-3  # [m]
BASIS_POISSON = 0.45  # [1] Of the shipped basis of deformation.ReducedFE
PATCH = 1.3484  # [1] K/(E/(1 - nu²) R) of deformation.ReducedFE, pressed at the top of the kidney
LAYERS = (3e-3, 27e-3)  # [m] Of deformation.BeamBundle
BEAMS = (10.8124, 2.70311)  # [1] Moduli of these layers over E/(1 - nu²), fitted to deformation.ReducedFE at this place


def under_finger(plane: float) -> dict[str, Any]:
    """Settings of `tissue` for a plane-strain modulus E/(1 - nu²) > 0 [Pa] under a patch of R = 8 mm: the linear law of
    MassSpring, `stiffness` 1.35 E/(1 - nu²) R [N/m] with `exponent` 1 [1]; `layers` [m] and `moduli` [Pa] of
    BeamBundle; and `young` [Pa] for ReducedFE with the Poisson's ratio of its basis.

    The factors are those of the kidney on its support, the surface under the patch held sideways (`palpate fit body
    kidney`). On a frictionless half-space the same pressure gives 5 pi/16 = 0.98 (K. L. Johnson, Contact Mechanics
    (1985), 3.4, at the centre).

    Modulus and force are proportional. A layer of a beam follows E_j e_j + E_j tau_j e_j' = sigma, so that with moduli
    a E_j the strains e_j(t) under a sigma(t) are those under sigma(t), at the limit of strain too. ReducedFE follows
    E u + E tau u' = C f. Beams with the force f(t) of ReducedFE for one motion of the surface have, with moduli a E_j,
    its force a f(t) with modulus a E for the same motion.
    """
    return {
        "stiffness": PATCH * plane * FINGER_RADIUS, "exponent": 1.0, "layers": LAYERS,
        "moduli": tuple(beam * plane for beam in BEAMS), "young": plane * (1.0 - BASIS_POISSON**2),
    }  # fmt: skip


def round_settings(settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with six digits, tuples as lists."""
    return {name: [_six(v) for v in value] if isinstance(value, tuple) else _six(value)
            for name, value in settings.items()}  # fmt: skip


def _six(value: float) -> float:
    return float(f"{value:.6g}")
