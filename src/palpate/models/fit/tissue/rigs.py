"""Force over indentation of each rig and law in closed form.

rig        law                                       force at the indentation s
ball       hertz                                     (4/3) E/(1 - nu²) sqrt(R) s^1.5
           layer                                     hertz times f(sqrt(R s)/h) of `physics.contact.layer`
           exponential                               (b/m) (exp(m s) - 1)
           power, hunt-crossley                      K s^n, K s^n <1 + c s'>
punch      hertz                                     2 E/(1 - nu²) a s
fingertip  power                                     the exponential law of the finger in series with K s^n; s is
                                                     the sum of both indentations
cylinder   linear, neo_hooke, ogden, ogden2,         pi R² P(1 - s/H), P of uniaxial stress: frictionless plates
           demiray, yeoh, yeoh3

Hertz and the flat punch: K. L. Johnson, Contact Mechanics (1985), 3.8, 4.2.

Rubber-like laws under a ball or between bonded plates: `tabulated`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from palpate.models.fit.sessions import SessionError
from palpate.physics.contact.layer import thickness_factor
from palpate.physics.materials.demiray import demiray
from palpate.physics.materials.hyperelastic import Material, uniaxial
from palpate.physics.materials.ogden import ogden
from palpate.physics.materials.yeoh import yeoh

Values = Mapping[str, float]
RATIO = 0.499  # Poisson's ratio of rubber-like laws in full finite elements, an approximation of 0.5
WIDEST, TALLEST = 0.1, 1.0  # [m] Upper bounds of radius and height; a larger value means a wrong unit
FINGER = (26.2641, 1681.06)
"""b [N/m] and m [1/m] of the fingertip's exponential law, from two published points on steel; same as in the scene
kidney."""


@dataclass(frozen=True)
class Parameter:
    """An unknown with its unit, initial guess and bounds; `log`: it is positive, and its logarithm is searched."""

    name: str
    unit: str
    guess: float
    low: float
    high: float
    log: bool = True

    def to_search(self, value: float) -> float:
        """A value in search coordinates."""
        return math.log(value) if self.log else value

    def at_limit(self, value: float) -> bool:
        """Whether a value lies at the end of the range of the search."""
        at, low, high = (self.to_search(v) for v in (value, self.low, self.high))
        return min(at - low, high - at) < 1e-3 * (high - low)

    def value(self, searched: float) -> float:
        """The inverse of `to_search`."""
        return math.exp(searched) if self.log else float(searched)


@dataclass(frozen=True)
class Rig:
    """The indenter: a ball, a flat punch, a fingertip, or plates on a cylinder; lengths in [m].

    SessionError: a length out of bounds.
    """

    kind: str
    radius: float = 8e-3
    height: float | None = None
    plates: str = "frictionless"
    poisson: float = 0.5

    def __post_init__(self) -> None:
        for name, size, most in (("radius", self.radius, WIDEST), ("height", self.height or WIDEST, TALLEST)):
            if not 0.0 < size <= most:
                raise SessionError(f"{name} of a {self.kind}: found {size:g} m, expected above 0, at most {most:g} m")


@dataclass(frozen=True)
class Law:
    """A force law: `force(values, s)` [N] of indentations [m] (n,) >= 0, and its parameters, moduli first.

    reach   [m] largest valid indentation
    remark  assumptions, for the report
    proportional  whether the force is proportional to the first parameter
    finer   of a table: (shape, s) -> force [N] (n,) with its modulus `tabulated.REFERENCE`, on a finer mesh
    """

    name: str
    parameters: tuple[Parameter, ...]
    force: Callable[[Values, np.ndarray], np.ndarray]
    reach: float = math.inf
    remark: str = ""
    fixed: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    proportional: bool = True
    finer: Callable[[Values, np.ndarray], np.ndarray] | None = None


YOUNG = Parameter("young", "Pa", 2e4, 1.0, 1e9)
SHAPES = {
    "linear": (),
    "neo_hooke": (),
    "ogden": (Parameter("alpha", "1", 3.0, -40.0, 40.0, False),),
    "ogden2": (
        Parameter("share", "1", 0.2, 0.0, 1.0, False),
        Parameter("alpha_1", "1", 2.0, -40.0, 6.0, False),
        Parameter("alpha_2", "1", 8.0, 6.0, 60.0, False),
    ),
    "demiray": (Parameter("b", "1", 0.3, 1e-4, 60.0),),
    "yeoh": (Parameter("c2_over_c1", "1", 0.1, -0.5, 20.0, False),),
    "yeoh3": (
        Parameter("c2_over_c1", "1", 0.0, -2.0, 20.0, False),
        Parameter("c3_over_c1", "1", 0.05, 0.0, 50.0, False),
    ),
}
"""Dimensionless parameters of the rubber-like laws, in addition to Young's modulus."""


def material(law: str, young: float, shape: Values) -> Material:
    """A rubber-like law from Young's modulus at rest [Pa] and its shape parameters, nearly incompressible."""
    shear = young / 3.0
    if law == "ogden":
        return ogden(RATIO, shear, shape["alpha"] or 1e-6)
    if law == "ogden2":
        alphas = (shape["alpha_1"] or 1e-6, shape["alpha_2"])
        return ogden(RATIO, (1.0 - shape["share"]) * shear, alphas[0], shape["share"] * shear, alphas[1])
    if law == "demiray":
        return demiray(2.0 * (1.0 + RATIO) * shear, RATIO, shape["b"])
    return yeoh(RATIO, shear / 2.0, *(shape[p.name] * shear / 2.0 for p in SHAPES[law]))


def closed_form(rig: Rig, law: str) -> Law:
    """The law of a rig in closed form; equations and sources at the top of the module.

    SessionError: the rig does not support the law, or a length is missing.
    """
    radius, plane = rig.radius, 1.0 - rig.poisson**2
    fixed = {"poisson": (rig.poisson, "1"), "radius": (radius, "m")}
    stiffness, exponent = Parameter("stiffness", "N/m^n", 3e3, 1e-3, 1e12), Parameter("exponent", "1", 1.5, 1.0, 3.0)
    # cylinder between frictionless plates: uniaxial compression
    if rig.kind == "cylinder" and law in SHAPES and rig.height:
        height, area, known = rig.height, math.pi * radius**2, {"radius": (radius, "m"), "height": (rig.height, "m")}
        if law == "linear":
            return Law(law, (YOUNG,), lambda v, s: v["young"] * area * s / height, fixed=known)

        def press_cylinder(v: Values, s: np.ndarray) -> np.ndarray:
            return -area * uniaxial(material(law, v["young"], v), np.maximum(1.0 - s / height, 0.05))

        return Law(law, (YOUNG, *SHAPES[law]), press_cylinder, fixed=known | {"poisson": (0.5, "1")})
    # ball: Hertz on a half-space, and on a bonded layer
    if rig.kind == "ball" and law == "hertz":
        size = 4.0 / 3.0 / plane * math.sqrt(radius)
        return Law(law, (YOUNG,), lambda v, s: size * v["young"] * s**1.5, 0.1 * radius, _HERTZ, fixed)
    if rig.kind == "ball" and law == "layer":
        if not rig.height:
            raise SessionError("law layer: expected --height, the thickness of the layer")
        height, size = rig.height, 4.0 / 3.0 / plane * math.sqrt(radius)
        factor = thickness_factor(rig.poisson)

        def press_layer(v: Values, s: np.ndarray) -> np.ndarray:
            return size * v["young"] * s**1.5 * factor(np.sqrt(radius * s) / height)

        known = {**fixed, "height": (height, "m")}
        reach = min(0.25 * radius, 0.15 * height, float(factor.x[-1]) ** 2 * height**2 / radius)
        remark = (
            "bonded to the ground, small strains: beyond 10 % of the ball's radius or the thickness a neo-Hooke layer "
            "is softer, by 5 % at the end of the range"
        )
        return Law(law, (YOUNG,), press_layer, reach, remark, known)
    # flat punch on a half-space
    if rig.kind == "punch" and law == "hertz":
        return Law(law, (YOUNG,), lambda v, s: 2.0 / plane * radius * v["young"] * s, 0.2 * radius,
                   "a half-space: thickness above ten radii", fixed)  # fmt: skip
    # empirical laws
    if law == "exponential":
        steep = Parameter("hardening", "1/m", 300.0, 1e-2, 1e5)
        first = Parameter("stiffness", "N/m", 100.0, 1e-3, 1e9)

        def exponential(v: Values, s: np.ndarray) -> np.ndarray:
            return v["stiffness"] / v["hardening"] * np.expm1(np.minimum(v["hardening"] * s, 500.0))

        return Law(law, (first, steep), exponential)
    if rig.kind == "fingertip" and law == "power":
        known = {"finger_stiffness": (FINGER[0], "N/m"), "finger_hardening": (FINGER[1], "1/m")}
        return Law(
            law, (stiffness, exponent), lambda v, s: _series(v["stiffness"], v["exponent"], s), fixed=known,
            proportional=False,
        )  # fmt: skip
    if law in ("power", "hunt-crossley"):
        return Law(law, (stiffness, exponent), lambda v, s: v["stiffness"] * s ** v["exponent"])
    raise SessionError(
        f"rig {rig.kind} does not support law {law}; ball: hertz, layer, exponential, power, hunt-crossley, and with "
        f"--height {_RUBBER}; punch: hertz, exponential, power, hunt-crossley; fingertip: power; cylinder, with "
        f"--diameter and --height: linear, {_RUBBER}"
    )


def _series(stiffness: float, exponent: float, total: np.ndarray) -> np.ndarray:
    """Force [N] (n,) at which ln(1 + F m/b)/m of the finger plus (F/K)^(1/n) of the tissue equals the total [m] (n,).

    Newton's method on ln F, in which the total is convex, from above: each part alone is at most the total.
    """
    b, m = FINGER
    force, pressed = np.zeros(len(total)), total > 0.0
    s = total[pressed]
    log = np.log(np.minimum(stiffness * s**exponent, b / m * np.expm1(np.minimum(m * s, 500.0))))
    for _ in range(12):
        reached = np.exp(log)
        tissue = (reached / stiffness) ** (1.0 / exponent)
        slope = tissue / exponent + reached / (b + m * reached)
        step = (tissue + np.log1p(reached * m / b) / m - s) / slope
        log -= step
        if not np.abs(step).max(initial=0.0) > 1e-9:  # the next step would be below 1e-17
            break
    force[pressed] = np.exp(log)
    return force


_RUBBER = ", ".join(name for name in SHAPES if name != "linear")
_HERTZ = "a half-space under a small contact: 10 % of the radius deep, thickness above ten contact radii"
