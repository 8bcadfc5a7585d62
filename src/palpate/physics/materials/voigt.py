"""Generalised Voigt chain: spring-damper elements in series, one backward Euler step in closed form; its materials.

One beam is h elements in series. Element j has length L_j, modulus E_j [Pa] and viscosity c_j [Pa s]:

    sigma = E_j e_j + c_j de_j/dt,        e = sum_j phi_j e_j,        phi_j = L_j / L

Compression is positive. A step of length T from the strains e_j to the imposed strain e has the solution

    b_j = E_j + c_j/T,   sigma = (e - sum_j phi_j (c_j/T) e_j / b_j) / sum_j phi_j / b_j,
    e_j <- ((c_j/T) e_j + sigma) / b_j

It is unconditionally stable, first order in T, and valid for c_j = 0 and for any T > 0.

V. A. Ho, S. Hirai, "Beam bundle model of human fingertip", eq. 2-5, with phi_j = 1, which is correct for elements of
equal length only.

The moduli of tissue and skin are from Table I of the beam bundle paper and agree with Maeno, Kobayashi & Yamazaki,
"Relationship between the structure of human finger tissue and the location of tactile receptors" (1998; quoted from
memory). That of bone was read from a damaged table and only has to be large. The printed viscosities (0.1,
10, 1 Pa s) give relaxation within 3 to 74 microseconds, while the paper shows seconds. Here the viscosity is E times a
relaxation time after Pawluk & Howe (1999). Details: docs/equations/beam-bundle.md.
"""

from dataclasses import dataclass

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array


@dataclass(frozen=True)
class ViscoelasticMaterial:
    """A linear viscoelastic material."""

    modulus: float  # [Pa] E
    relaxation: float  # [s] viscosity / modulus: the retardation time of one Voigt element
    poisson: float = 0.48  # [1] nu, assumed

    @property
    def viscosity(self) -> float:
        """c [Pa s]."""
        return self.modulus * self.relaxation

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) [Pa]."""
        return self.modulus / (2 * (1 + self.poisson))


TISSUE = ViscoelasticMaterial(3.4e4, 1.4)  # modulus stated, relaxation assumed (slow part of Pawluk & Howe)
SKIN = ViscoelasticMaterial(1.36e5, 0.07)  # modulus stated, relaxation assumed (middle part of Pawluk & Howe)
BONE = ViscoelasticMaterial(1.5e10, 0.0)  # modulus inferred, no relaxation

STRAIN_LIMIT = 0.9
"""Largest compressive strain of an element [1]: the linear law is invalid beyond it, and at 1 the length is zero."""


@kernel
def chain_strain_step(strains: Array, moduli: Array, viscosities: Array, shares: Array, strain: float, dt: float):
    """Step one chain to an imposed strain, see the equation above; updates `strains` and returns the stress [Pa] >= 0.

    A chain that would pull separates and recovers freely (stress 0). Elements are limited to STRAIN_LIMIT, and the
    others take up the remaining strain. Elements of share 0 are absent.

    strains     [1]    (h)  of the elements, compression positive
    moduli      [Pa]   (h)  viscosities [Pa s] (h)   shares [1] (h)  L_j / L, sum 1
    strain      [1]    ()   imposed on the whole chain
    dt          [s]    ()   > 0
    """
    h = strains.shape[0]
    held = 0
    # implicit Euler with one stress for the whole chain, repeated with the elements that passed the limit fixed at it
    for _ in range(h + 1):
        rest = strain
        compliance = 0.0
        for j in range(h):
            if shares[j] == 0.0:
                continue
            if held >> j & 1:
                rest -= shares[j] * STRAIN_LIMIT
            else:
                rate = viscosities[j] / dt
                compliance += shares[j] / (moduli[j] + rate)
                rest -= shares[j] * rate * strains[j] / (moduli[j] + rate)
        if compliance == 0.0:
            break
        stress = max(rest, 0.0) / compliance
        passed = 0
        for j in range(h):
            if shares[j] > 0.0 and not held >> j & 1:
                rate = viscosities[j] / dt
                if (rate * strains[j] + stress) / (moduli[j] + rate) > STRAIN_LIMIT:
                    passed |= 1 << j
        if passed == 0:
            for j in range(h):
                rate = viscosities[j] / dt
                if held >> j & 1:
                    strains[j] = STRAIN_LIMIT
                elif shares[j] > 0.0:
                    strains[j] = (rate * strains[j] + stress) / (moduli[j] + rate)
            return stress
        held |= passed
    # all elements are at the limit: the stress that brings them there
    stress = 0.0
    for j in range(h):
        if shares[j] > 0.0:
            stress = max(stress, moduli[j] * STRAIN_LIMIT + viscosities[j] / dt * (STRAIN_LIMIT - strains[j]))
            strains[j] = STRAIN_LIMIT
    return stress


@kernel
def chain_stress_step(strains: Array, moduli: Array, viscosities: Array, shares: Array, stress: float, dt: float):
    """Step one chain under an imposed stress [Pa] >= 0, e_j <- min(((c_j/T) e_j + sigma)/b_j, STRAIN_LIMIT); updates
    `strains` and returns the strain [1] of the chain. Other arguments as for `chain_strain_step`."""
    total = 0.0
    for j in range(strains.shape[0]):
        if shares[j] > 0.0:
            rate = viscosities[j] / dt
            strains[j] = min((rate * strains[j] + stress) / (moduli[j] + rate), STRAIN_LIMIT)
            total += shares[j] * strains[j]
    return total


@kernel
def chain_compliance(moduli: Array, viscosities: Array, shares: Array, dt: float):
    """d strain/d stress = sum_j phi_j/(E_j + c_j/T) [1/Pa] of a step of length dt > 0 [s], no element at its limit."""
    total = 0.0
    for j in range(moduli.shape[0]):
        if shares[j] > 0.0:
            total += shares[j] / (moduli[j] + viscosities[j] / dt)
    return total
