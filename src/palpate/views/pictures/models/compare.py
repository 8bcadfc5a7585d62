"""One touch computed by several models: curves and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.records.compare import Variant
from palpate.views.pictures.style import figure as blank
from palpate.views.pictures.style import look, save

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@look()
def figure(variants: Sequence[Variant]) -> Figure:
    """One picture: force and indentation over time of every variant, and their differences from the first."""
    first_name = readable(variants[0].name)
    others = f"{len(variants) - 1} variant{'s' if len(variants) > 2 else ''}"
    out = blank(11, 6.5, f"One touch: {others} compared with {first_name}")
    axes = out.subplots(2, 2, sharex=True)
    first = np.array(variants[0].curves).reshape(-1, 3)
    units = ((1, "force [N]", 1.0), (2, "indentation [mm]", 1e3))
    for (column, label, factor), (above, below) in zip(units, axes.T, strict=True):
        for variant in variants:
            curve = np.array(variant.curves).reshape(-1, 3)
            above.plot(curve[:, 0], curve[:, column] * factor, label=readable(variant.name), linewidth=1.2)
            times, mine, theirs = np.intersect1d(curve[:, 0], first[:, 0], return_indices=True)
            below.plot(times, (curve[mine, column] - first[theirs, column]) * factor, linewidth=1.2)
        above.set_ylabel(label)
        quantity, unit = label.split(" ")
        below.set(ylabel=f"{quantity} minus that\nof {first_name} {unit}", xlabel="time [s]")
    axes[0, 0].legend(fontsize=8)
    return out


def readable(name: str) -> str:
    """A variant's name without the syntax of settings: `tissue.use=deformation.Rigid tissue.stiffness=300` becomes
    `Rigid, stiffness 300`."""
    parts = []
    for part in name.split():
        key, equals, value = part.partition("=")
        setting = key.rpartition(".")[2].replace("_", " ")
        if not equals:
            parts.append(part)
        else:
            parts.append(value.rpartition(".")[2] if setting == "use" else f"{setting} {value}")
    return ", ".join(parts)


def draw_comparison(variants: Sequence[Variant], path: Path) -> list[Path]:
    picture = figure(variants)
    path.parent.mkdir(parents=True, exist_ok=True)
    save(picture, path, dpi=140)
    return [path]
