"""Labels at points of a plot that do not lie on one another."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from matplotlib.transforms import Bbox

PLACES = [
    (dx, dy) for far in (6, 14, 26, 42, 62) for dx, dy in
    ((far, far / 2), (far, -far), (-far, far / 2), (-far, -far), (0, far), (0, -far - 4), (far, 0), (-far, 0))
]  # fmt: skip
"""[point] From the point to the label, the nearer ones first."""
CLEAR = 4.0
"""[pixel] Between a label and an axis."""


def place(
    axes: Axes,
    wanted: Sequence[tuple[float, float, str, str]],
    points: Sequence[tuple[float, float]] = (),
    size: float = 7.5,
) -> list[Bbox]:
    """Write labels (x, y, text, colour) inside the axes where they cover neither one another nor one of the points.
    Returns the boxes [pixel]; a label without a free place is left out."""
    canvas = axes.figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    canvas.draw()
    canvas.figure.set_layout_engine("none")  # else the axes move once more when the labels are there
    renderer = canvas.get_renderer()
    frame = axes.get_window_extent(renderer)
    spots = axes.transData.transform([*((x, y) for x, y, *_ in wanted), *points])
    taken = [Bbox.from_bounds(a - 4, b - 4, 8, 8) for a, b in spots]
    boxes: list[Bbox] = []
    for x, y, text, colour in wanted:
        for dx, dy in PLACES:
            label = axes.annotate(
                text, (x, y), xytext=(dx, dy), textcoords="offset points", fontsize=size, color=colour,
                ha="left" if dx > 0 else "right" if dx < 0 else "center", va="center",
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "alpha": 0.6, "shrinkB": 3},
            )  # fmt: skip
            label.set_in_layout(False)
            label.update_positions(renderer)
            box = Text.get_window_extent(label, renderer)  # of the text alone, without its line
            inside = all((frame.x0 + CLEAR < box.x0, box.x1 < frame.x1, frame.y0 + CLEAR < box.y0, box.y1 < frame.y1))
            if inside and not any(box.overlaps(b) for b in taken + boxes):
                boxes.append(box)
                break
            label.remove()
    return boxes
