"""Path of the finger over the organ, from above and from the side: the fingertip's bone edge, coloured by the force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.messages import Pose
from palpate.views.errors import PictureError
from palpate.views.pictures import style
from palpate.views.pictures.touch import TouchStreams, together, touches
from palpate.views.surface.moments import bodies_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from palpate.physics.geometry.mesh import Mesh

ORDER, OF_A_FINGER = 5, True

VIEWS = {"from above": (0, 1, 2, 1.0), "from the side": (0, 2, 1, -1.0)}
"""Horizontal and vertical axis, the axis of the view, and the direction along it in which the eye is."""
LIGHT = np.array([0.35, 0.35, 0.87])  # [1] direction to the light, in the axes of a view; the last one is to the eye
SHADES = (0.72, 0.97)  # [1] grey of a face away from and towards the light
MARKS = 8  # instants with a label
APART = 0.06  # [1] least distance of two labels, as a fraction of the wider view
LIGHTEST = 0.2  # [1] of the scale of colours that begins the path's: lighter ones are hard to see on the organ
ROOM = 0.08  # [1] margin of a view, as a fraction of its size
POINTS = 4000  # of the path


def draw_picture(touch: TouchStreams) -> Figure | None:
    """None without a contact, a pose or a body with a mesh, or if nothing was touched."""
    contact, pose = touch.contact, touch[Pose]
    if contact is None or pose is None or not touches(contact["time"], contact["force"]):
        return None
    try:
        mesh = bodies_of(touch).mesh
    except PictureError:
        return None
    contact, pose = together(contact, pose)
    every = slice(None, None, max(len(pose["time"]) // POINTS, 1))
    time, place, force = pose["time"][every], 1e3 * pose["position"][every], contact["force"][every]
    size = np.ptp(np.concatenate([1e3 * mesh.vertices, place]), axis=0)
    wide = 11.5
    heights = [max(size[y] / size[x], 0.2) for x, y, *_ in VIEWS.values()]
    out = style.figure(wide, 1.4 + 0.78 * wide * sum(heights), "Path of the finger over the organ")
    shown = marks(time, place, force)
    for axes, (name, view) in zip(out.subplots(2, 1, height_ratios=heights), VIEWS.items(), strict=True):
        _draw_body(axes, mesh, *view)
        drawn = _draw_path(axes, place[:, view[:2]], force)
        _draw_marks(axes, time, place[:, view[:2]], shown)
        x, y = ("xyz"[axis] for axis in view[:2])
        axes.set(xlabel=f"{x} [mm]", ylabel=f"{y} [mm]", aspect="equal")
        axes.set_title(name)
        axes.margins(ROOM)
    out.axes[1].legend(loc="upper right", fontsize=9)
    bar = out.colorbar(drawn, ax=out.axes[:2], label="normal force [N]", shrink=0.6, aspect=32, pad=0.015)
    bar.outline.set_visible(False)  # type: ignore[operator]
    return out


def _draw_body(axes: Axes, mesh: Mesh, x: int, y: int, depth: int, side: float) -> None:
    """Draw the faces of the organ that the eye sees, the farthest first, in shades of grey."""
    from matplotlib.collections import PolyCollection

    corners = 1e3 * mesh.vertices[mesh.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    seen = np.flatnonzero(side * normal[:, depth] > 0.0)
    seen = seen[np.argsort(side * corners[seen].mean(axis=1)[:, depth], kind="stable")]
    lit = np.clip(normal[seen][:, [x, y, depth]] * (1.0, 1.0, side) @ LIGHT, 0.0, 1.0)
    grey = SHADES[0] + (SHADES[1] - SHADES[0]) * lit
    colours = np.repeat(grey[:, None], 3, axis=1) * (1.0, 0.96, 0.94)
    faces: Any = corners[seen][:, :, [x, y]]
    axes.add_collection(PolyCollection(faces, facecolors=colours, linewidths=0.0, antialiaseds=False, rasterized=True))
    axes.autoscale_view()


def _draw_path(axes: Axes, place: np.ndarray, force: np.ndarray) -> Any:
    """Draw the path (n,2) [mm], coloured where the finger presses; returns what the colour bar shows."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    axes.plot(*place.T, color=style.NORMAL, linewidth=0.9, linestyle=(0, (4, 2)), label="in free space", zorder=3)
    pressed = force > 0.0
    pieces: Any = np.stack([place[:-1], place[1:]], axis=1)[pressed[1:]]
    top = float(force.max())
    shades = style.deformation_colours()(np.linspace(LIGHTEST, 1.0, 256))
    line = LineCollection(pieces, cmap=ListedColormap(shades), linewidths=2.6, zorder=4, capstyle="round")
    line.set_array(force[1:][pressed[1:]])
    line.set_clim(0.0, top)
    axes.add_collection(line)
    return line


def _draw_marks(axes: Axes, time: np.ndarray, place: np.ndarray, rows: list[int]) -> None:
    from matplotlib.patheffects import withStroke

    axes.plot(*place[rows].T, "o", color=style.INK, markersize=4, markerfacecolor="white", zorder=5)
    for row in rows:
        axes.annotate(f"{time[row]:.2f} s", place[row], xytext=(4, 5), textcoords="offset points", fontsize=9, zorder=6,
                      path_effects=[withStroke(linewidth=2.2, foreground="white")])  # fmt: skip


def marks(time: np.ndarray, place: np.ndarray, force: np.ndarray) -> list[int]:
    """Rows of the instants that are labelled: the start, begin, largest force and end of each touch, and the end.

    time [s] (n), place [mm] (n,3), force [N] (n). An instant near a labelled one is left out.
    """
    wanted = [0, len(time) - 1]
    for part in touches(time, force):
        wanted += [part.start, part.start + int(np.argmax(force[part])), part.stop - 1]
    least, rows = APART * float(np.ptp(place, axis=0).max()), list[int]()
    for row in wanted:
        if len(rows) < MARKS and all(np.linalg.norm(place[row] - place[other]) > least for other in rows):
            rows.append(row)
    return sorted(rows)
