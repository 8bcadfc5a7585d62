"""The deformed surface at several instants, coloured by displacement."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from palpate.views.pictures.style import INK, deformation_bar, figure, place_panels
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.colour import COLOURS, paint_vertices, round_up
from palpate.views.surface.moments import Instant, bodies_of, instants
from palpate.views.surface.off_screen import Rendering

TITLE = "The surface under the finger  (ball: fingertip; arrow: force on the hand"
COUNT, COLUMNS = 6, 3
BLOCK = (0.32, 0.2)  # [1] width and height of the scales, as a fraction of the picture's
LONGEST = 0.16  # [1] largest length of a scale, as a fraction of the picture's width
ARROW = "#1f3b57"  # of the arrows in the pictures


class Views:
    """Renders the surface in a subprocess, which starts at once."""

    def __init__(self, touch: TouchStreams) -> None:
        self.bodies = shown = bodies_of(touch)
        mesh = shown.mesh
        self.instants: list[Instant] = instants(touch, shown, COUNT)
        count = len(self.instants)
        self.columns = min(COLUMNS, count)
        self.near = sorted(sorted(range(count), key=lambda i: -self.instants[i].loads.max())[: self.columns])
        lengths = [paint_vertices(COLOURS["displacement"], mesh, instant.surface) for instant in self.instants]
        self.deepest = round_up(max(float(length.max()) for length in lengths))
        self._rendering = Rendering(mesh, self.instants, lengths, self.near, self.deepest)

    def close(self) -> None:
        self._rendering.close()

    def draw_views(self) -> Figure:
        """The figure. PictureError: this machine cannot render it."""
        pixels = self._rendering.pixels()
        columns = self.columns
        rows = -(-len(self.instants) // columns)
        several = "; numbers from left to right" if len(self.instants[0].tips) > 1 else ""
        out = figure(3.8 * columns + 1.0, 2.4 * rows + 3.1, f"{TITLE}{several})", layout="none")
        grid = out.subplots(rows + 1, columns, squeeze=False, height_ratios=[1.0] * rows + [1.22])
        place_panels(out, rows + 1, columns, left=0.1, right=1.15, bottom=0.1, top=0.6, across=0.25, down=0.28)
        for axes in grid.ravel():
            axes.set_axis_off()
        for i, instant in enumerate(self.instants):
            axes = grid[i // columns][i % columns]
            axes.imshow(pixels["wide"][i])
            _scales(axes, pixels["wide_pixel"][i], float(pixels["newton"]))
            axes.set_title(instant.title(), y=1.0, fontsize=11, loc="center")
        for axes, i, picture, size in zip(grid[rows], self.near, pixels["close"], pixels["close_pixel"], strict=True):
            axes.imshow(picture)
            _scales(axes, size, float(pixels["newton"]))
            axes.set_title(f"the same at {self.instants[i].time:.2f} s, near", y=1.0, fontsize=11, loc="center")
        label = COLOURS["displacement"].label
        width = out.get_figwidth()
        scale = out.add_axes((1.0 - 0.95 / width, 0.2, 0.13 / width, 0.6))
        deformation_bar(out, self.deepest * 1e3, label, cax=scale)
        return out


def _scales(axes: Axes, pixel: float, newton: float) -> None:
    """Draw a bar of a round length, and an arrow of a round force, in the corner that shows the least of the body.

    pixel  [m] size of a pixel across the view;  newton  [m/N] length of an arrow of 1 N
    """
    image = np.asarray(axes.get_images()[0].get_array())
    height, width = image.shape[:2]
    left, top = emptiest(image.min(axis=2) < 250, *BLOCK)
    x, low = (left + 0.03) * width, (top + BLOCK[1] - 0.05) * height
    length, force = (round_down(LONGEST * width * pixel / unit) for unit in (1e-3, newton))
    bars = (
        (low, length * 1e-3 / pixel, f"{length:g} mm", INK, "-"),
        (low - 0.1 * height, force * newton / pixel, f"{force:g} N", ARROW, "-|>"),
    )
    for y, long, text, colour, style in bars:
        look = {"arrowstyle": style, "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (x + long, y), (x, y), arrowprops=look)
        edge = [withStroke(linewidth=2.5, foreground="white")]
        axes.text(x + long + 0.015 * width, y, text, fontsize=10, va="center", path_effects=edge)


def emptiest(covered: np.ndarray, wide: float, high: float) -> tuple[float, float]:
    """Left and top [1] of the corner block (wide, high) [1] of a picture (h,w) with the fewest covered pixels; the
    lower left one if several are equal."""
    height, width = covered.shape
    corners = [(left, top) for top in (1.0 - high, 0.0) for left in (0.0, 1.0 - wide)]

    def inside(corner: tuple[float, float]) -> int:
        x, y = round(corner[0] * width), round(corner[1] * height)
        return int(covered[y : y + round(high * height), x : x + round(wide * width)].sum())

    return min(corners, key=inside)


def round_down(value: float) -> float:
    """The largest of 1, 2, 5 times a power of 10 that does not exceed the value."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * max(digit for digit in (1.0, 2.0, 5.0) if digit * power <= value * (1.0 + 1e-9))
