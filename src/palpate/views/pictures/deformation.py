"""The deformed surface at several instants, coloured by displacement."""

from matplotlib.figure import Figure

from palpate.views.pictures.style import deformation_bar, figure
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.colour import COLOURS, painted, round_up
from palpate.views.surface.moments import Instant, bodies_of, instants
from palpate.views.surface.off_screen import Rendering

TITLE = "The surface under the finger  (ball: fingertip; arrow: force on the hand"
COUNT, COLUMNS = 6, 3


class Views:
    """Renders the surface in a subprocess, which starts at once."""

    def __init__(self, touch: TouchStreams) -> None:
        self.bodies = shown = bodies_of(touch)
        mesh = shown.mesh
        self.instants: list[Instant] = instants(touch, shown, COUNT)
        count = len(self.instants)
        self.columns = min(COLUMNS, count)
        self.near = sorted(sorted(range(count), key=lambda i: -self.instants[i].depth)[: self.columns])
        lengths = [painted(COLOURS["displacement"], mesh, instant.surface) for instant in self.instants]
        self.deepest = round_up(max(float(length.max()) for length in lengths))
        self._rendering = Rendering(mesh, self.instants, lengths, self.near, self.deepest)

    def close(self) -> None:
        self._rendering.close()

    def draw(self) -> Figure:
        """The figure. PictureError: this machine cannot render it."""
        pixels = self._rendering.pixels()
        columns = self.columns
        rows = -(-len(self.instants) // columns)
        several = "; numbers from left to right" if len(self.instants[0].tips) > 1 else ""
        out = figure(4.2 * columns + 1.0, 2.6 * rows + 3.3, f"{TITLE}{several})")
        grid = out.subplots(rows + 1, columns, squeeze=False, height_ratios=[1.0] * rows + [1.22])
        for axes in grid.ravel():
            axes.set_axis_off()
        for i, instant in enumerate(self.instants):
            axes = grid[i // columns][i % columns]
            axes.imshow(pixels["wide"][i])
            axes.set_title(instant.title(), fontsize=11, loc="center")
        for axes, i, picture in zip(grid[rows], self.near, pixels["close"], strict=True):
            axes.imshow(picture)
            axes.set_title(f"the same at {self.instants[i].time:.2f} s, near", fontsize=11, loc="center")
        label = COLOURS["displacement"].label
        deformation_bar(out, self.deepest * 1e3, label, ax=grid, shrink=0.6, aspect=32, pad=0.015)
        return out
