"""Hyperelastic materials: a law, which is one file of this folder, and its constants.

A law splits its energy into an isochoric and a volumetric part,

    Psi(F) = W(F) + U(J),    W(a F) = W(F) for any number a,

so that the mixed element can use one mean volume ratio per element. A file `x.py` of this folder is a law if it has

    strain_energy   the compiled law, below
    x(...)          a function that gives a `Material` from its constants
    EXAMPLE         constants that x takes, for tests and tables

and the equation in its docstring. Laws are found, not registered: finite elements (`palpate.models.fe.x`), sampled
bodies, checks, `palpate list laws` and the consistency tests use every file. Compiled with `kernel(pointer=True)`,

    strain_energy(F, J, p, P, A) -> (W, U, U', U'')

F  [1]  (3,3)  deformation gradient        P [Pa] (3,3)  output dW/dF, first Piola-Kirchhoff
J  [1]  ()     volume ratio                A [Pa] (9,9)  output d2W/dF2, row 3i + j for F[i, j]. NaN at A[0, 0]: no
p       (n,)   constants of the material                 tangent is needed, and A is scratch

A law in the invariants I and II only has to supply its derivatives by these: see `neo_hooke` and
`invariants.shape_stress`.
"""

import importlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any, NamedTuple, cast

import numpy as np

from palpate.compiler.entry_point import is_compiled
from palpate.compiler.kernel import kernel
from palpate.physics import materials
from palpate.physics.arrays import Array
from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.materials.compiled import call_law, compile_law, law_address, law_signature
from palpate.registry import modules

Law = Callable[..., tuple[float, float, float, float]]

RUBBER = 1e9  # [Pa] Largest Young's modulus of a rubber-like solid: ten times that of the hardest rubber

MIXED_FROM = 0.47
"""Poisson's ratio at rest from which a law of this folder uses the mixed element. Below it, the plain element converges
faster in smooth fields (error ~ size³ instead of size^1.4) and withstands deeper indentation; above it, the plain
element is too stiff near edges (docs/equations/finite-elements.md)."""
PLAIN_UP_TO = 0.499  # Poisson's ratio at rest above which the plain element locks and is refused


class MaterialError(PalpateError, ValueError):
    """Constants of an unstable material, or an unknown law; says which, what was found and what is expected."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Material:
    """A law with its constants.

    small       small strain: J = 1 + div u, for laws that are linear in the displacement
    """

    law: Law  # compiled function, see the head of this file
    parameters: tuple[float, ...]  # its constants
    mixed: bool = False  # one mean volume ratio for each element (no locking near incompressibility)
    small: bool = False

    @property
    def name(self) -> str:
        """Name of its law, as the argument of `law`: the file, or the full name of a function elsewhere."""
        module, function = (getattr(self.law, key, "") for key in ("__module__", "__qualname__"))
        folder, _, file = module.rpartition(".")
        return file if folder == materials.__name__ and function == "strain_energy" else f"{module}.{function}"


def moduli(young: float, poisson: float) -> tuple[float, float]:
    """Shear and bulk modulus [Pa], mu = E/(2 (1 + nu)) and kappa = E/(3 (1 - 2 nu)), from Young's modulus [Pa] and
    Poisson's ratio. MaterialError: a modulus that is not positive, or a ratio outside (-1, 0.5)."""
    if not (np.isfinite(young) and young > 0):
        raise MaterialError(f"Young's modulus {young} Pa: expected a positive number")
    if not -1.0 < poisson < 0.5:
        raise MaterialError(
            f"Poisson's ratio {poisson}: expected a number above -1 and below 0.5; for an incompressible "
            "material take 0.499 with the mixed element"
        )
    return young / (2.0 * (1.0 + poisson)), young / (3.0 * (1.0 - 2.0 * poisson))


def of_rest(law: str, shear: float, poisson: float) -> tuple[float, float]:
    """Shear and bulk modulus [Pa] of a rubber-like law from its shear modulus at rest [Pa] and Poisson's ratio.
    MaterialError: see `moduli`; a modulus above that of any rubber."""
    if not (np.isfinite(shear) and shear > 0):
        raise MaterialError(f"{law}, shear modulus {shear:.4g} Pa at rest: expected a positive number")
    moduli(1.0, poisson)  # refuses the ratio
    young = 2.0 * shear * (1.0 + poisson)
    rubberlike(law, young)
    return moduli(young, poisson)


@kernel
def _uniaxial(address: int, p: Array, stretch: Array, stress: Array):
    P, A, F = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((3, 3))
    for i in range(len(stretch)):
        across = stretch[i] ** -0.5
        F[0, 0], F[1, 1], F[2, 2] = stretch[i], across, across
        A[0, 0] = np.nan
        call_law(address, F, 1.0, p, P, A)
        stress[i] = P[0, 0] - P[1, 1] * across / stretch[i]


def uniaxial(material: Material, stretch: np.ndarray) -> np.ndarray:
    """Nominal stress [Pa] (n,) of an incompressible body of this law under uniaxial stretch [1] (n,), sides free:
    P = dW/dF11 - dW/dF22 l2/l1 with l2 = l1^(-1/2). U does not contribute."""
    stress = np.empty(len(stretch))
    place = place_of(material.law, material.name)
    _uniaxial(place, np.array(material.parameters), np.asarray(stretch, float), stress)
    return stress


def rest_moduli(material: Material) -> tuple[float, float]:
    """Shear and bulk modulus [Pa] of the undeformed material, from the tangent of its law. MaterialError: one is
    not positive."""
    P, A = np.zeros((3, 3)), np.zeros((9, 9))
    law: Any = compile_law(material.law, law_signature())
    _, _, _, bulk = law(np.eye(3), 1.0, np.array(material.parameters), P, A)
    shear = A[1, 1]
    if not (np.isfinite(shear) and np.isfinite(bulk) and shear > 0 and bulk > 0):
        raise MaterialError(
            f"law {material.name}: shear modulus {shear:.4g} Pa, bulk modulus {bulk:.4g} Pa at rest, "
            "expected positive ones"
        )
    return float(shear), float(bulk)


def poisson_of(shear: float, bulk: float) -> float:
    """Poisson's ratio [1] from the shear and bulk modulus [Pa], (3 kappa - 2 mu)/(2 (3 kappa + mu))."""
    return (3.0 * bulk - 2.0 * shear) / (2.0 * (3.0 * bulk + shear))


def wants_mixed(shear: float, bulk: float) -> bool:
    """Whether the mixed element suits a material with these moduli at rest, see `MIXED_FROM`."""
    return poisson_of(shear, bulk) > MIXED_FROM - 1e-9


def rubberlike(law: str, young: float) -> None:
    """MaterialError: the Young's modulus [Pa] at rest is too large for a rubber-like solid."""
    if young > RUBBER:
        raise MaterialError(
            f"{law}, Young's modulus {young:.4g} Pa: no rubber-like solid has more than {RUBBER:g} Pa. Moduli are in "
            f"pascals ({young:.4g} Pa is {1e-3 * young:.4g} kPa); for bone, metal or glass take `hencky`"
        )


def laws() -> dict[str, ModuleType]:
    """The files of this folder that define a law, by name."""
    every = modules(materials).items()
    return {name: module for name, module in every if hasattr(module, "strain_energy") and hasattr(module, name)}


def constructor(name: str) -> Callable[..., Material]:
    """The function that makes a material of a law of this folder. AttributeError: an unknown law."""
    modules = laws()
    if name not in modules:
        raise AttributeError(f"no material law {name!r}; laws: {', '.join(modules)}")
    return cast(Callable[..., Material], getattr(modules[name], name))


def example(name: str) -> Material:
    """A material of a law of this folder, for tests and tables."""
    return constructor(name)(*laws()[name].EXAMPLE)


def law(name: str) -> Law:
    """The compiled law of a name, see `Material.name`. The name may come from an untrusted file: a function outside
    palpate is found only if the program has already imported its module, and nothing but a compiled function is
    returned. MaterialError: an unknown law."""
    module, _, function = name.rpartition(".")
    if module and module not in sys.modules and not module.startswith(f"{__name__.partition('.')[0]}."):
        raise MaterialError(f"law {name!r} lies outside palpate, and no file imports code: import {module} first")
    try:
        library: Any = importlib.import_module(module or f"{materials.__name__}.{name}")
        found = getattr(library, function if module else "strain_energy")
    except (ImportError, AttributeError, ValueError):
        found = None
    if not is_compiled(found):
        raise MaterialError(
            f"no material law {name!r}: expected {', '.join(laws())}, or the full name of a compiled function"
        )
    return cast(Law, found)


class PlacedLaw(NamedTuple):
    """A law with its name."""

    law: Any  # a `Law`, which a type checker would take for a method
    name: str


_placed: dict[int, PlacedLaw] = {}


def place_of(law: Law, name: str) -> int:
    """Address of a law's code in this process, for kernels with several laws (`compiled.call_law`)."""
    place = law_address(law)
    _placed[place] = PlacedLaw(law, name)
    return place


def known_places() -> Mapping[int, PlacedLaw]:
    """The laws by the addresses that `place_of` has returned."""
    return _placed


def name_at(place: int) -> str:
    """The name of the law at an address that `place_of` returned."""
    return _placed[int(place)].name
