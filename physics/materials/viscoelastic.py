"""Materials of the fingertip and the sources of their constants.

The moduli of tissue and skin are from Table I of the beam bundle paper and agree with Maeno, Kobayashi & Yamazaki,
"Relationship between the structure of human finger tissue and the location of tactile receptors" (1998; quoted from
memory). Those of bone and nail were read from a damaged table and only have to be large. The printed viscosities (0.1,
10, 1 Pa s) give relaxation within 3 to 74 microseconds, while the paper shows seconds. Here the viscosity is E times a
relaxation time after Pawluk & Howe (1999). Details: docs/equations/beam-bundle.md.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ViscoelasticMaterial:
    """A linear viscoelastic material.

    status      source of the numbers: "stated", "literature", "inferred" or "assumed", in decreasing reliability
    """

    modulus: float  # [Pa] E
    relaxation: float  # [s] viscosity / modulus: the retardation time of one Voigt element
    poisson: float = 0.48  # [1] nu
    status: str = "assumed"

    @property
    def viscosity(self) -> float:
        """c [Pa s]."""
        return self.modulus * self.relaxation

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) [Pa]."""
        return self.modulus / (2 * (1 + self.poisson))


TISSUE = ViscoelasticMaterial(3.4e4, 1.4, status="modulus stated, relaxation assumed (slow part of Pawluk & Howe)")
SKIN = ViscoelasticMaterial(1.36e5, 0.07, status="modulus stated, relaxation assumed (middle part of Pawluk & Howe)")
BONE = ViscoelasticMaterial(1.5e10, 0.0, status="modulus inferred, no relaxation")
NAIL = ViscoelasticMaterial(4.3e9, 0.0, status="modulus inferred, no relaxation; rigid in the bundle")
