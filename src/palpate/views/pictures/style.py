"""The common style of all figures: fonts, colours, axes, and the smoothing of noisy samples."""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from palpate.physics.archive import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#2b2b33"
FAINT = "#b9b9c4"
FINGER = "#e27c60"
TISSUE = "#961826"
NORMAL = "#1f507a"
FRICTION = "#b86c00"
SPEED = "#0b745d"
ENERGY = "#715bb9"
"""These stay distinct with deuteranopia, protanopia and tritanopia; a test checks each pair."""
REGION_A = "#cfe3f2"
REGION_B = "#fbe3c0"
DEFORMATION = ["#f3dcd0", "#f2b48c", "#ec7f5b", "#d2434f", "#9c1c5b", "#5b1360", "#240b40"]
"""Colours from no to largest deformation; lightness falls evenly, so that they are distinct in greyscale."""

Layout = Literal["constrained", "none"]
SMOOTH = 0.02  # [s] window of the running mean of lines
DPI = 150
COMPRESSION = 3  # of PNG, 0 to 9: half the time of the usual 6, and files 10 % larger
COLUMNS = 3000
"""Columns of points to which a line over time is decimated: more than the pixels of the widest picture."""

LOOK: Any = {
    "font.family": "sans-serif",
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.titlelocation": "left",
    "axes.labelsize": 11,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#77777f",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e8e8ee",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 10,
    "figure.facecolor": "white",
    "figure.titlesize": 15,
    "savefig.dpi": DPI,
}


def legend_above(axes: Axes, **more: Any) -> None:
    """Put the legend above the right end of the axes, where it covers no data."""
    count = len(axes.get_legend_handles_labels()[1])
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=count, borderaxespad=0.1, **more)


@contextmanager
def look() -> Iterator[None]:
    """Draw in this style; also a decorator of functions that draw."""
    from matplotlib import rc_context

    with rc_context(LOOK):
        yield


def figure(width: float, height: float, title: str, current: bool = False, layout: Layout = "constrained") -> Figure:
    """An empty figure of this size [inch], without a window; a notebook displays it.

    current  make it pyplot's current figure if the program uses pyplot, except in a notebook, which would show it twice
    layout   "none": the caller places the panels, as by `place_panels`
    """
    pyplot = sys.modules.get("matplotlib.pyplot")
    if current and pyplot is not None and "inline" not in pyplot.get_backend():
        fig: Figure = pyplot.figure(figsize=(width, height), layout=layout, FigureClass=_notebook_figure())
    else:
        fig = _notebook_figure()(figsize=(width, height), layout=None if layout == "none" else layout)
    entitle(fig, title)
    return fig


def place_panels(
    figure: Figure, rows: int, columns: int, *, left: float = 0.75, right: float = 0.1, bottom: float = 0.6,
    top: float = 0.65, across: float = 0.9, down: float = 0.45,
) -> None:  # fmt: skip
    """Set the margins around a grid of panels, and the gaps across and down between them [inch], in place of solving
    for them, which measures all texts several times and takes a third of the time of a picture."""
    width, height = figure.get_size_inches()
    wide = (width - left - right - (columns - 1) * across) / columns
    high = (height - top - bottom - (rows - 1) * down) / rows
    figure.subplots_adjust(
        left / width, bottom / height, 1.0 - right / width, 1.0 - top / height, across / wide, down / high
    )


def entitle(figure: Figure, title: str) -> None:
    """Set the title; without a layout engine, which moves it there and the panels below it, at the upper edge."""
    place = {} if figure.get_layout_engine() else {"y": 1.0 - 0.03 / figure.get_figheight(), "va": "top"}
    figure.suptitle(title, x=0.01, ha="left", weight="bold", **place)


@cache
def _notebook_figure() -> type[Figure]:
    """The class of figures that notebooks display."""
    from matplotlib import rcParams
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    class Shown(Figure):
        def savefig(self, fname: Any, *, dpi: Any = None, **given: Any) -> None:
            """As of matplotlib, but a PNG is drawn once: matplotlib draws it without output before, for its layout."""
            if given or self.canvas.manager is not None or str(fname)[-4:] != ".png":
                super().savefig(fname, dpi=dpi, **given)
                return
            wanted = rcParams["savefig.dpi"] if dpi is None else dpi
            before, self.dpi = self.dpi, self.dpi if wanted == "figure" else wanted
            try:
                FigureCanvasAgg(self).print_png(fname, pil_kwargs={"compress_level": COMPRESSION})
            finally:
                self.dpi = before

        def _repr_png_(self) -> bytes:
            drawn = io.BytesIO()
            self.savefig(drawn, format="png", dpi=100)
            return drawn.getvalue()

    return Shown


def mean(values: np.ndarray, time: np.ndarray, span: float = SMOOTH) -> np.ndarray:
    """Running mean over a window [s]; shorter at the ends."""
    if len(time) < 3:
        return values
    step = float(np.median(np.diff(time)))
    half = int(span / step / 2) if step > 0 else 0
    if half < 1:
        return values
    total = np.concatenate([[0.0], np.cumsum(values, dtype=float)])
    at = np.arange(len(values))
    reach = np.minimum(half, np.minimum(at, len(values) - 1 - at))  # symmetric, so that the ends do not shift
    return (total[at + reach + 1] - total[at - reach]) / (2 * reach + 1)


def noise(values: np.ndarray) -> float:
    """Standard deviation of the noise in evenly spaced samples (n), from the median absolute second difference."""
    if len(values) < 5:
        return 0.0
    second = values[2:] - 2.0 * values[1:-1] + values[:-2]
    return float(np.median(np.abs(second))) / (0.6745 * np.sqrt(6.0))


def decimate(figure: Figure) -> None:
    """Decimate long lines over time to the minimum and maximum of each column of points."""
    for line in (line for axes in figure.axes for line in axes.lines):
        x, y = (np.asarray(values, dtype=float) for values in line.get_data(orig=False))
        if len(x) <= 4 * COLUMNS or not (np.diff(x) >= 0.0).all():
            continue
        size = -(-len(x) // COLUMNS)
        rows = np.concatenate([y, np.full(size * COLUMNS - len(y), np.nan)]).reshape(COLUMNS, size)
        first = np.arange(COLUMNS) * size
        least = first + np.argmin(np.where(np.isnan(rows), np.inf, rows), axis=1)
        greatest = first + np.argmax(np.where(np.isnan(rows), -np.inf, rows), axis=1)
        at = np.unique(np.minimum(np.concatenate([least, greatest, [0]]), len(x) - 1))
        line.set_data(x[at], y[at])


def log_ticks(axes: Axes, side: str = "x") -> None:
    """Set a logarithmic axis, "x" or "y", with labels at 1, 2 and 5 in each decade; more would overlap."""
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.set(**{f"{side}scale": "log"})
    axis = axes.xaxis if side == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def deformation_table() -> np.ndarray:
    """The colours of deformations (256,4) as RGBA bytes, without matplotlib; the same as `deformation_colours`."""
    ends = np.array([[*bytes.fromhex(colour[1:]), 255] for colour in DEFORMATION], dtype=float)
    at, knots = np.linspace(0.0, 1.0, 256), np.linspace(0.0, 1.0, len(ends))
    rows = np.column_stack([np.interp(at, knots, column) for column in ends.T])
    return np.round(rows).astype(np.uint8)


def deformation_colours() -> Any:
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("deformation", DEFORMATION)


def deformation_bar(figure: Figure, top: float, label: str, **place: Any) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    bar = figure.colorbar(ScalarMappable(Normalize(0.0, top), deformation_colours()), label=label, **place)
    bar.outline.set_visible(False)  # type: ignore[operator]


def save(picture: Figure, path: Path, **how: Any) -> None:
    """Write a picture, complete or not at all; `how` as of matplotlib's `savefig`. OSError: the file is unchanged."""
    with replacing(path) as part:
        picture.savefig(part, **how)


def saved(folder: Path, **pictures: Figure) -> list[Path]:
    """Write each picture as `name.png` to the folder."""
    for name, picture in pictures.items():
        save(picture, folder / f"{name}.png")
    return [folder / f"{name}.png" for name in pictures]
