"""Force over depth of rubber-like laws by axisymmetric finite elements, tabulated over the shape parameter of the law.

The force is linear in Young's modulus. Presses are computed once at Chebyshev points of the dimensionless parameter,
and ln F is interpolated between them, so that a fit costs as much as in closed form. The report compares the result
with a finer mesh.
"""

import math

import numpy as np
from scipy.interpolate import BarycentricInterpolator, PchipInterpolator

from palpate.models.fe.axisymmetric import Indenter, cylinder, layer, press
from palpate.models.fe.progress import Report, unheard
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.rigs import SHAPES, YOUNG, Law, Parameter, Rig, Values, material

DEPTHS = 12  # Number of depths in a table; their spacing is smallest near first contact
NODES = 6  # Number of values of the shape parameter in a table
REFERENCE = 1e4  # [Pa] Young's modulus of the tables


def curve(rig: Rig, law: str, shape: Values, depths: np.ndarray, count: int) -> np.ndarray:
    """Force [N] at depths [m] (n,) with `REFERENCE` as Young's modulus and `count` elements across; NaN without
    equilibrium."""
    made = material(law, REFERENCE, shape)
    assert rig.height is not None  # of these rigs
    if rig.kind == "cylinder":
        body = cylinder(rig.radius, rig.height, count)
        return press(body, made, Indenter(body.top, rig.plates == "bonded", body.side), depths / 2.0)
    contact = min(1.2 * math.sqrt(rig.radius * float(depths[-1])), 1.2 * rig.radius)
    body = layer(rig.height, contact, count)
    under = body.top[: 2 * int(np.searchsorted(body.across[::2], 2.0 * contact)) + 1]
    return press(body, made, Indenter(np.zeros(0, np.int64), False, under, rig.radius), depths)


def check_tabulated(rig: Rig, law: str) -> None:
    """SessionError: this law cannot be tabulated for the rig, or the thickness is missing."""
    if len(SHAPES.get(law, (YOUNG, YOUNG))) > 1 or law == "linear" or rig.kind not in ("ball", "cylinder"):
        known = ", ".join(name for name, shapes in SHAPES.items() if len(shapes) < 2 and name != "linear")
        raise SessionError(f"rig {rig.kind}, law {law} in finite elements: expected ball or cylinder, and {known}")
    if not rig.height:
        raise SessionError(f"law {law} in finite elements: expected --height, the thickness of the specimen")


def tabulated(
    rig: Rig, law: str, deepest: float, middle: float | None = None, count: int = 8, report: Report = unheard
) -> Law:
    """A law of `SHAPES` with at most one shape parameter, tabulated around its value `middle` to `deepest` [m].

    SessionError: an unsupported law, no thickness, or no equilibrium at small depths.
    """
    check_tabulated(rig, law)
    # Chebyshev nodes of the shape parameter
    shapes = SHAPES[law]
    depths = deepest * np.linspace(0.0, 1.0, DEPTHS + 1)[1:] ** 1.5
    parameters: tuple[Parameter, ...] = ()
    power = 1.0 if rig.kind == "cylinder" else 1.5
    if not shapes:
        nodes = np.zeros(1)
    else:
        parameter = shapes[0]
        low, high = _range(parameter, middle)
        nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos((np.arange(NODES) + 0.5) * math.pi / NODES)
        ends = (float(parameter.value(low)), float(parameter.value(high)))
        guess = float(min(max(parameter.guess if middle is None else middle, ends[0]), ends[1]))
        parameters = (Parameter(parameter.name, parameter.unit, guess, *ends, parameter.log),)
    # finite-element press at each node
    forces = []
    for node in nodes:
        shape = {parameter.name: parameter.value(node)} if shapes else {}
        forces.append(curve(rig, law, shape, depths, count))
        report(1.0 / len(nodes))
    reached = int(np.isfinite(forces).all(axis=0).sum())
    if reached < 4:
        raise SessionError(f"rig {rig.kind}, law {law}: no equilibrium beyond {1e3 * depths[reached - 1]:.3g} mm")
    # interpolate ln(F/s^power): barycentric over the parameter, monotone cubic over the depth
    ratio = np.log(np.array(forces)[:, :reached] / depths[:reached] ** power)
    across = BarycentricInterpolator(nodes, ratio) if shapes else None
    knots = np.r_[0.0, depths[:reached]]

    def force(values: Values, s: np.ndarray) -> np.ndarray:
        row = ratio[0] if across is None else across(parameter.searched(values[parameter.name]))
        along = PchipInterpolator(knots, np.r_[row[0], row])
        return values["young"] / REFERENCE * np.exp(along(np.clip(s, 0.0, knots[-1]))) * s**power

    fixed = {"radius": (rig.radius, "m"), "height": (rig.height or 0.0, "m"), "poisson": (0.5, "1")}
    between = rig.plates if rig.kind == "cylinder" else "bonded to the ground, frictionless ball"
    remark = f"full finite elements, {between}"
    return Law(law, (YOUNG, *parameters), force, float(knots[-1]), remark, fixed)


def _range(parameter: Parameter, middle: float | None) -> tuple[float, float]:
    """Ends of the table in search coordinates."""
    if parameter.log:
        centre = math.log(parameter.guess if middle is None else middle)
        return max(centre - 2.0, math.log(parameter.low)), min(centre + 2.0, math.log(parameter.high))
    if middle is None:
        return (-8.0, 12.0) if parameter.name == "alpha" else (parameter.low, 3.0)
    wide = max(4.0, 0.6 * abs(middle)) if parameter.name == "alpha" else max(0.3, abs(middle))
    return max(middle - wide, parameter.low), min(middle + wide, parameter.high)
