"""Laws without a closed form, tabulated by axisymmetric finite elements: rubber under a ball or between bonded plates.

The force is linear in Young's modulus. Presses are computed once at Chebyshev points of the dimensionless parameter,
and ln F is interpolated between them, so that a fit costs as much as in closed form. `Law.finer` computes the force on
a finer mesh, for the error of the table.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BarycentricInterpolator, PchipInterpolator

from palpate.models.fe.axisymmetric import Indenter, cylinder, layer, press_round
from palpate.models.fe.progress import Report, unheard
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.rigs import SHAPES, YOUNG, Law, Parameter, Rig, Values, material

DEPTHS = 12  # Number of depths in a table; their spacing is smallest near first contact
NODES = 6  # Number of values of the shape parameter in a table
REFERENCE = 1e4  # [Pa] Young's modulus of the tables
FINE = 14  # Elements across the contact in the finer mesh that checks the table


@dataclass(frozen=True)
class ForceTable:
    """Forces [N] (nodes, depths) with `REFERENCE` as Young's modulus at depths [m] (depths,) without 0, for values
    (nodes,) of the shape parameter in search coordinates; one node if the law has none."""

    nodes: np.ndarray
    depths: np.ndarray
    forces: np.ndarray


def curve(rig: Rig, law: str, shape: Values, depths: np.ndarray, count: int) -> np.ndarray:
    """Force [N] at depths [m] (n,) with `REFERENCE` as Young's modulus and `count` elements across; NaN without
    equilibrium."""
    made = material(law, REFERENCE, shape)
    assert rig.height is not None  # of these rigs
    if rig.kind == "cylinder":
        body = cylinder(rig.radius, rig.height, count)
        return press_round(body, made, Indenter(body.top, rig.plates == "bonded", body.side), depths / 2.0)
    contact = min(1.2 * math.sqrt(rig.radius * float(depths[-1])), 1.2 * rig.radius)
    body = layer(rig.height, contact, count)
    under = body.top[: 2 * int(np.searchsorted(body.across[::2], 2.0 * contact)) + 1]
    return press_round(body, made, Indenter(np.zeros(0, np.int64), False, under, rig.radius), depths)


def check_tabulated(rig: Rig, law: str) -> None:
    """SessionError: this law cannot be tabulated for the rig, or the thickness is missing."""
    if len(SHAPES.get(law, (YOUNG, YOUNG))) > 1 or law == "linear" or rig.kind not in ("ball", "cylinder"):
        known = ", ".join(name for name, shapes in SHAPES.items() if len(shapes) < 2 and name != "linear")
        raise SessionError(f"rig {rig.kind}, law {law} in finite elements: expected ball or cylinder, and {known}")
    if not rig.height:
        raise SessionError(f"law {law} in finite elements: expected --height, the thickness of the specimen")


def tabulate_law(
    rig: Rig, law: str, deepest: float, middle: float | None = None, count: int = 8, report: Report = unheard
) -> Law:
    """A law of `SHAPES` with at most one shape parameter, tabulated around its value `middle` to `deepest` [m].

    SessionError: an unsupported law, no thickness, or no equilibrium at small depths.
    """
    return law_of_table(rig, law, compute_table(rig, law, deepest, middle, count, report), middle)


def compute_table(
    rig: Rig, law: str, deepest: float, middle: float | None = None, count: int = 8, report: Report = unheard
) -> ForceTable:
    """The table of `tabulate_law`."""
    check_tabulated(rig, law)
    # Chebyshev nodes of the shape parameter
    shapes = SHAPES[law]
    depths = deepest * np.linspace(0.0, 1.0, DEPTHS + 1)[1:] ** 1.5
    nodes = np.zeros(1)
    if shapes:
        low, high = _range(shapes[0], middle)
        nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos((np.arange(NODES) + 0.5) * math.pi / NODES)
    # finite-element press at each node
    forces = []
    for node in nodes:
        forces.append(curve(rig, law, {p.name: p.value(node) for p in shapes}, depths, count))
        report(1.0 / len(nodes))
    reached = int(np.isfinite(forces).all(axis=0).sum())
    if reached < 4:
        raise SessionError(f"rig {rig.kind}, law {law}: no equilibrium beyond {1e3 * depths[reached - 1]:.3g} mm")
    return ForceTable(nodes, depths[:reached], np.array(forces)[:, :reached])


def law_of_table(rig: Rig, law: str, table: ForceTable, middle: float | None = None) -> Law:
    """The law that interpolates ln(F/s^power): barycentric over the parameter, monotone cubic over the depth."""
    shapes, power = SHAPES[law], 1.0 if rig.kind == "cylinder" else 1.5
    parameters: tuple[Parameter, ...] = ()
    if shapes:
        half = np.cos(0.5 * math.pi / NODES)  # of the Chebyshev points, over that of the range
        first, last = float(table.nodes[0]), float(table.nodes[-1])
        wide = 0.5 * (last - first) * (1.0 / half - 1.0)
        ends = (float(shapes[0].value(first - wide)), float(shapes[0].value(last + wide)))
        guess = min(max(shapes[0].guess if middle is None else middle, ends[0]), ends[1])
        parameters = (replace(shapes[0], guess=float(guess), low=ends[0], high=ends[1]),)
    ratio = np.log(table.forces / table.depths**power)
    across = BarycentricInterpolator(table.nodes, ratio) if shapes else None
    knots = np.r_[0.0, table.depths]

    def force(values: Values, s: np.ndarray) -> np.ndarray:
        row = ratio[0] if across is None else across(shapes[0].to_search(values[shapes[0].name]))
        along = PchipInterpolator(knots, np.r_[row[0], row])
        return values["young"] / REFERENCE * np.exp(along(np.clip(s, 0.0, knots[-1]))) * s**power

    def finer(shape: Values, s: np.ndarray) -> np.ndarray:
        return curve(rig, law, shape, s, FINE)

    fixed = {"radius": (rig.radius, "m"), "height": (rig.height or 0.0, "m"), "poisson": (0.5, "1")}
    between = rig.plates if rig.kind == "cylinder" else "bonded to the ground, frictionless ball"
    remark = f"full finite elements, {between}"
    return Law(law, (YOUNG, *parameters), force, float(knots[-1]), remark, fixed, finer=finer)


def scale_law(law: Law, rig: Rig, factor: float) -> Law:
    """A tabulated law for the rig whose lengths are `factor` times those of the table's: F(s) = factor² F(s/factor)."""
    own, finer = law.force, law.finer
    assert finer is not None  # of a table
    fixed = law.fixed | {"radius": (rig.radius, "m"), "height": (rig.height or 0.0, "m")}  # type: ignore[operator]

    def scaled(force: Callable[[Values, np.ndarray], np.ndarray]) -> Callable[[Values, np.ndarray], np.ndarray]:
        return lambda values, s: factor**2 * force(values, s / factor)

    return replace(law, force=scaled(own), finer=scaled(finer), reach=law.reach * factor, fixed=fixed)


def _range(parameter: Parameter, middle: float | None) -> tuple[float, float]:
    """Ends of the table in search coordinates."""
    if parameter.log:
        centre = math.log(parameter.guess if middle is None else middle)
        return max(centre - 2.0, math.log(parameter.low)), min(centre + 2.0, math.log(parameter.high))
    if middle is None:
        return (-8.0, 12.0) if parameter.name == "alpha" else (parameter.low, 3.0)
    wide = max(4.0, 0.6 * abs(middle)) if parameter.name == "alpha" else max(0.3, abs(middle))
    return max(middle - wide, parameter.low), min(middle + wide, parameter.high)
