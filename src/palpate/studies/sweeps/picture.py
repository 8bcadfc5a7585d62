"""Pictures of a `Study`: curves over time, a number over the varied settings, sensitivity indices with intervals."""

from __future__ import annotations

import contextlib
import importlib.util
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import choices
from palpate.physics.extras import missing
from palpate.studies.sweeps.keep import Kept
from palpate.views.errors import PictureError
from palpate.views.pictures.style import FRICTION, INK, NORMAL, figure, look, save
from palpate.views.plot import PREFIXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEGEND = 8  # Maximum number of lines in a legend; more lines get a colour scale if their values are numbers
DASHES: tuple[Any, ...] = ("-", "--", ":", "-.")
"""Line styles of lines of one colour, which differ in the other varied settings."""
SHARES = {
    "sobol": (("S1", "alone"), ("ST", "with interactions")),
    "morris": (("mu_star", "mean size"), ("sigma", "spread")),
}


def draw_quantity(study: Any, name: str, ax: Axes | None = None) -> Figure:
    """Draw a quantity or a kept result into `ax` or a new figure; returns the figure. PictureError: it cannot be
    drawn."""
    if importlib.util.find_spec("matplotlib") is None:
        raise PictureError(missing("plots", "matplotlib", "view"))
    found = [one for one in study.keep if name in (one.text, one.quantity)]
    if not found:
        known = sorted({text for one in study.keep for text in (one.quantity, one.text)})
        raise PictureError(f"this study keeps no {name!r}. {choices('Kept', name, known)}")
    found.sort(key=lambda one: one.how != "curve")
    one = found[0] if study.sensitivity is None else next((k for k in found if k.how != "curve"), found[0])
    with look():
        axes = figure(9.0, 4.6, f"{study.name}: {one.text}", current=True).subplots() if ax is None else ax
        if one.how == "curve":
            _curves(study, one, axes)
        elif study.sensitivity is not None:
            _shares(study, one, axes)
        else:
            _numbers(study, one, axes)
    whole: Any = axes.figure
    return whole


def draw_all(study: Any, folder: Path) -> list[Path]:
    files = []
    for one in study.keep:
        file = folder / f"{one.text.replace(' ', '-')}.png"
        with contextlib.suppress(PictureError):
            save(draw_quantity(study, one.text), file)
            files.append(file)
    return files


def _scale_values(one: Kept, values: Any) -> tuple[Any, str]:
    """Values in the unit of the figure, and the label of the axis."""
    factor, unit = PREFIXES.get(one.unit, (1.0, one.unit))
    return np.asarray(values) * factor, f"{one.quantity} [{unit}]"


def _numeric(values: list[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _varied_path(study: Any, rows: list[dict[str, Any]]) -> tuple[str, list[str]]:
    """The path of the colour or abscissa, which is the first with numbers, and the other crossed paths."""
    space = study.space
    path = next((p for p in space.paths if _numeric([row[p] for row in rows])), space.paths[0])
    return path, [p for axis in space.crossed if path not in axis.paths for p in axis.paths]


def _name_row(study: Any, row: dict[str, Any], paths: list[str]) -> str:
    return ", ".join(study.value_text(path, row[path]) for path in paths)


def _curves(study: Any, one: Kept, axes: Axes) -> None:
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.lines import Line2D

    from palpate.studies.sweeps.store import Store

    rows = [row for row in study.rows() if not row["error"]]
    if not rows:
        raise PictureError(f"{one.text!r}: no point has a curve; study.table() says why")
    store, slots = Store(study.home(), write=False), [row["slot"] for row in rows]
    times = store.curves(f"{one.text} time", slots)
    values, label = _scale_values(one, store.curves(one.text, slots))
    # Colour by the first numeric path, line style by the other crossed paths.
    path, others = _varied_path(study, rows)
    shades: Any = [row[path] for row in rows]
    known = list(dict.fromkeys(shades))
    scale = Normalize(min(shades), max(shades)) if _numeric(shades) else Normalize(0, max(1, len(known) - 1))
    most = 0.9 if len(known) <= LEGEND else 1.0  # leaves out the brightest yellow, which is hardly visible
    places = known if _numeric(shades) else range(len(known))
    colours = {shade: colormaps["viridis"](most * scale(place)) for shade, place in zip(known, places, strict=True)}
    names = [_name_row(study, row, others) for row in rows]
    kinds = list(dict.fromkeys(names))
    dashes = dict(zip(kinds, DASHES, strict=False)) if len(kinds) <= len(DASHES) else {}
    for k, shade in enumerate(shades):
        axes.plot(times[k], values[k], color=colours[shade], linewidth=1.2, linestyle=dashes.get(names[k], "-"))
    # Legend or colour bar of the colours, and a legend of the line styles.
    if len(known) <= LEGEND:
        lines = [Line2D([], [], color=colours[shade], label=study.value_text(path, shade)) for shade in known]
        axes.legend(handles=lines, title=study.axis_label(path), loc="center left", bbox_to_anchor=(1.0, 0.5))
    elif _numeric(shades):
        axes.figure.colorbar(ScalarMappable(scale, "viridis"), ax=axes, label=study.axis_label(path))
    if len(kinds) > 1:
        title = ", ".join(map(study.axis_label, others))
        if dashes:
            lines = [Line2D([], [], color=INK, linestyle=dashes[kind], label=kind) for kind in kinds]
            axes.figure.legend(handles=lines, title=title, loc="outside lower center", ncols=len(kinds))
        else:
            axes.set_title(f"lines of one colour: {len(kinds)} values of {title}", fontsize=11)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)


def _numbers(study: Any, one: Kept, axes: Axes) -> None:
    rows = [row for row in study.rows() if not row["error"]]
    if not rows:
        raise PictureError(f"{one.text!r}: no point has a number; study.table() says why")
    across, others = _varied_path(study, rows)
    drawn = any(across in axis.paths for axis in study.space.sampled)
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(_name_row(study, row, others), []).append(row)
    for name, group in groups.items():
        values, label = _scale_values(one, [row[one.text] for row in group])
        where = [row[across] if _numeric([row[across]]) else study.value_text(across, row[across]) for row in group]
        axes.plot(where, values, "." if drawn else ".-", label=name or None)
        axes.set_ylabel(label)
    if len(groups) > 1:
        axes.legend(title=", ".join(map(study.axis_label, others)), loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes.set_xlabel(study.axis_label(across))


def _shares(study: Any, one: Kept, axes: Axes) -> None:
    table = study.indices()
    table = table[table["of"] == one.text]
    names = [", ".join(str(v) for k, v in row.items() if k in study.space.paths) for row in table.to_dict("records")]
    rows = [f"{name}, {parameter}".lstrip(", ") for name, parameter in zip(names, table["parameter"], strict=True)]
    at = np.arange(len(rows))[::-1]
    assert study.sensitivity is not None
    for k, (index, words) in enumerate(SHARES[study.sensitivity]):
        spread, found, place = table.get(f"{index}_conf"), table[index], at + 0.2 - 0.4 * k
        bars, colour = found, (NORMAL, FRICTION)[k]
        if study.sensitivity == "sobol":
            bars = found.clip(0.0, 1.0)  # estimates outside 0 ... 1 are noise of few samples, which the interval shows
            axes.set_xlim(0.0, 1.05)
        axes.barh(place, bars, 0.38, color=colour, label=f"{index}, {words}")
        axes.errorbar(found, place, xerr=spread, fmt="none", ecolor="black", elinewidth=1.0, capsize=3)
    axes.set_yticks(at, rows)
    share = "share of the variance of" if study.sensitivity == "sobol" else "change over the range,"
    axes.set_xlabel(f"{share} {one.text} [{'1' if study.sensitivity == 'sobol' else one.unit}]")
    axes.legend(loc="lower right")
