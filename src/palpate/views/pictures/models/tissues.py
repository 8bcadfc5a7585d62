"""Published moduli of an organ as forces under a finger and under a ball, next to the law of a shipped scene."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import NOWHERE
from palpate.launch.load.tissues import material, settings, spread_of, tissues
from palpate.physics.contact.under_finger import FINGER_RADIUS
from palpate.physics.materials.hyperelastic import poisson_of, rest_moduli
from palpate.units.quantity import convert
from palpate.views.pictures.style import FINGER, FRICTION, INK, NORMAL, SPEED, TISSUE, figure, look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DEEPEST = 10e-3  # [m] the end of the scale of deformations in the kidney study
HERTZ = 0.5  # [1] contact radius over that of the ball up to which Hertz theory is drawn as valid
COLOURS = (NORMAL, FRICTION, SPEED, TISSUE, FINGER)
STYLES = ("-", "--", "-.", ":")
SHARE = 0.16  # opacity of a spread


def organ_of(name: str) -> str:
    """The organ of a record: the first word of its name."""
    return name.partition("-")[0]


@look()
def draw_tissues(name: str, path: Path) -> list[Path]:
    """Draw a published tissue, thick, next to the others of its organ; returns the file. GraphError: unknown name."""
    settings(name, NOWHERE)
    organ = organ_of(name)
    records = {key: record for key, record in tissues()[0].items() if organ_of(key) == organ}
    out = figure(13.2, 6.4, f"{organ.capitalize()}: {name} next to the published tissues")
    left, right = out.subplots(1, 2)
    depth = np.linspace(0.0, DEEPEST, 201)
    for number, (key, record) in enumerate(records.items()):
        colour, style = COLOURS[number % len(COLOURS)], STYLES[number // len(COLOURS) % len(STYLES)]
        line = {"color": INK, "linewidth": 3.2} if key == name else {"color": colour, "linestyle": style}
        spread = spread_of(record)
        for axes, force, valid in (
            (left, patch_force(settings(key, NOWHERE), depth), np.ones(len(depth), bool)),
            (right, ball_force(plane_modulus(record), depth), depth <= HERTZ**2 * FINGER_RADIUS),
        ):
            _draw_law(axes, depth, force, valid, spread, line, _label(key, record))
    left.set_title(f"MassSpring under a fingertip's patch of {1e3 * FINGER_RADIUS:g} mm: F = K sⁿ")
    right.set_title(f"a rigid ball of {1e3 * FINGER_RADIUS:g} mm (Hertz; thin: a > R/2, outside)")
    for axes in (left, right):
        axes.set(xlabel="indentation s [mm]", ylabel="force [N]", xlim=(0.0, 1e3 * DEEPEST), ylim=(0.0, None))
    _legend(out, left)
    return _written(out, path)


def _written(picture: Figure, path: Path) -> list[Path]:
    save(picture, path)
    return [path]


def _draw_law(
    axes: Axes, depth: np.ndarray, force: np.ndarray, valid: np.ndarray, spread: float, line: Any, label: str
) -> None:
    """Draw a force, thin where its theory is not valid, with its spread [1] as a band."""
    axes.plot(1e3 * depth, np.where(valid, force, np.nan), label=label, **line)
    axes.plot(1e3 * depth, np.where(valid, np.nan, force), **{**line, "linewidth": 0.35 * line.get("linewidth", 1.8)})
    if spread > 0.0:
        low, high = (1.0 - spread) * force, (1.0 + spread) * force
        axes.fill_between(1e3 * depth, low, high, color=line["color"], alpha=SHARE, linewidth=0)


def _label(name: str, record: Mapping[str, Any]) -> str:
    of_shear = spread_of(record) * convert(str(record["shear"]), "Pa") / 1e3 if "spread" in record else 0.0
    rate, spread = str(record["rate"]), f" ± {of_shear:.2g} kPa" if of_shear else ""
    state = f"{record['state']}, {rate}" if rate not in ("not read", "any") else record["state"]
    if record["grade"] == "assumed":
        state = record["source"]
    return f"{name}: {state}; G = {record['shear']}{spread}"


def _legend(out: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    out.legend(handles, labels, loc="outside lower left", ncols=2, fontsize=10)


def plane_modulus(record: Mapping[str, Any]) -> float:
    """E/(1 - nu²) = 2 G/(1 - nu) [Pa] at rest of a record."""
    shear, bulk = rest_moduli(material(record))
    return 2.0 * shear / (1.0 - poisson_of(shear, bulk))


def patch_force(law: Mapping[str, Any], depth: np.ndarray) -> np.ndarray:
    """K s^n [N] (n) of MassSpring's settings at indentations s [m] (n)."""
    return np.asarray(law["stiffness"] * depth ** law["exponent"])


def ball_force(plane: float, depth: np.ndarray) -> np.ndarray:
    """(4/3) E* sqrt(R) s^(3/2) [N] (n), Hertz, of a rigid ball of R = 8 mm at indentations s [m] (n).

    plane [Pa] E* = E/(1 - nu²); valid for a contact radius sqrt(R s) well below R.
    """
    return np.asarray(4.0 / 3.0 * plane * np.sqrt(FINGER_RADIUS) * depth**1.5)
