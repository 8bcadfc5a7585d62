"""A run that goes on in a window of the desktop, drawn by pyvista: organ, fingertip, force arrow, numbers."""

from __future__ import annotations

import json
import os
import struct
import sys
from importlib.util import find_spec
from types import SimpleNamespace
from typing import Any

import numpy as np

from palpate.launch.load.extras import install
from palpate.physics.errors import MISUSE, PalpateError
from palpate.views.page.watch import Watch
from palpate.views.pictures.colour import COLOURS, able, painted

TIP = 6e-3
"""[m] Radius of the ball that stands for the fingertip."""
LENGTH = 0.012
"""[m/N] Of the force arrow."""
STEP = 15
"""[ms] that the window gets for the mouse between two frames."""


class NoWindow(PalpateError, RuntimeError):
    """Why no window can be opened, and what would work."""

    exit_code = MISUSE


def why_not() -> str:
    """Why no window can be opened here; empty where one can."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "no display (DISPLAY is not set)"
    if find_spec("pyvista") is None:
        return f"pyvista is missing: {install('view')}"
    return ""


def unpacked(data: bytes) -> tuple[dict[str, Any], np.ndarray, np.ndarray, np.ndarray]:
    """Head, indices and both arrays of what `feed.packed` has made."""
    (length,) = struct.unpack_from("<I", data)
    head = json.loads(data[4 : 4 + length])
    a, b, c = head["sizes"]
    at = 4 + length
    return (head, np.frombuffer(data, "<u4", a, at), np.frombuffer(data, "<f4", b, at + 4 * a),
            np.frombuffer(data, "<f4", c, at + 4 * (a + b)))  # fmt: skip


def _library() -> Any:
    import pyvista  # what it declares of its types is not what it takes

    return pyvista


class Window:
    """The window: `open` it, then `run` until it is closed. `off_screen` draws without one."""

    def __init__(self, watch: Watch, off_screen: bool = False) -> None:
        from matplotlib.colors import LinearSegmentedColormap

        from palpate.views.pictures.style import DEFORMATION

        pyvista = self._pyvista = _library()
        self._watch, self._frame, self._status, self._numbers = watch, b"", "", ""
        self.ended = False
        """Set from another thread: `run` returns."""
        _, triangles, places, _ = unpacked(watch.mesh)
        self._rest = places.reshape(-1, 3).astype(float)
        self.organ: Any = pyvista.make_tri_mesh(self._rest.copy(), triangles.reshape(-1, 3).astype(np.int64))
        self.organ["value"] = np.zeros(len(self._rest))
        self._undeformed = SimpleNamespace(vertices=self._rest, triangles=triangles.reshape(-1, 3).astype(np.int64))
        self._shape: Any = None
        self.colour = COLOURS["displacement"]
        self._top = self.colour.least
        self.plotter: Any = pyvista.Plotter(title="palpate", off_screen=off_screen, window_size=[1000, 700])
        colours = LinearSegmentedColormap.from_list("deformation", DEFORMATION)
        self._actor = self.plotter.add_mesh(
            self.organ, scalars="value", cmap=colours, clim=(0.0, self.colour.scale * self._top), smooth_shading=True,
            show_scalar_bar=False,
        )  # fmt: skip
        self._bar()
        self.plotter.add_key_event("c", self.another_colour)
        self._ball = pyvista.Sphere(radius=TIP)
        self._tip = self.plotter.add_mesh(self._ball, color="#c88c6b", opacity=0.45)
        self._tip.SetVisibility(False)
        self._arrow = self.plotter.add_mesh(pyvista.Arrow(), color="#1f6ba8")
        self._arrow.SetVisibility(False)
        self._text = self.plotter.add_text("", position="upper_left", font_size=11, color="#222222")
        self.plotter.camera_position = "xz"
        self.plotter.camera.azimuth, self.plotter.camera.elevation = -25.0, 30.0
        self.plotter.reset_camera()

    def open(self) -> None:
        """Show it. NoWindow: what the display lacks."""
        self.plotter.show(interactive_update=True, auto_close=False)
        if not self.plotter.off_screen and "EGL" in self.plotter.render_window.GetClassName():
            raise NoWindow("the display has no OpenGL that VTK can use (Debian: apt install libgl1 libglx-mesa0). "
                           "--view web shows the run in the browser")  # fmt: skip

    def run(self) -> None:
        """Draw each new frame until the window is closed."""
        closed: list[bool] = []
        self.plotter.iren.add_observer("ExitEvent", lambda *_: closed.append(True))
        while not closed and not self.ended and self.plotter.render_window is not None:
            self.refresh()
            self.plotter.update(STEP)
        self.plotter.close()

    def refresh(self) -> bool:
        """Take what is new of the run; whether anything is."""
        frame, status = self._watch.frame, self._watch.status
        if frame is self._frame and status == self._status:
            return False
        self._status = status
        if frame is not self._frame:
            self._frame = frame
            self._show(*unpacked(frame))
        else:
            self._say({})
        return True

    def another_colour(self) -> None:
        """The next colour that the body tells of."""
        if self._shape is None:
            return
        can = able(self._shape)
        self.plotter.remove_scalar_bar(self.colour.label)
        self.colour = COLOURS[can[(can.index(self.colour.name) + 1) % len(can) if self.colour.name in can else 0]]
        self._top = self.colour.least
        self._bar()
        self._paint()

    def _bar(self) -> None:
        self.plotter.add_scalar_bar(self.colour.label, mapper=self._actor.mapper, n_labels=2, fmt="%.1f")

    def _paint(self) -> None:
        values = painted(self.colour, self._undeformed, self._shape)
        self._top = max(self._top, float(values.max(initial=0.0)))
        self.organ["value"] = self.colour.scale * values
        self._actor.mapper.scalar_range = (0.0, self.colour.scale * self._top)

    def _show(self, head: dict[str, Any], nodes: np.ndarray, moved: np.ndarray, pressure: np.ndarray) -> None:
        points, moved = self._rest.copy(), moved.reshape(-1, 3)
        points[nodes] += moved
        self.organ.points = points
        self._shape = SimpleNamespace(
            nodes=nodes, displacement=moved, pressure=pressure, slipped=np.array(head.get("slipped", ()), dtype=float)
        )
        if self.colour.name not in able(self._shape):
            self.another_colour()
        self._paint()
        self._point(head)
        self._say(head)

    def _point(self, head: dict[str, Any]) -> None:
        """Fingertip and force arrow."""
        tip = head.get("tip")
        self._tip.SetVisibility(tip is not None)
        if tip is None:
            return
        centre = np.array(tip) + TIP * np.array(head["up"])
        self._tip.SetPosition(*centre)
        force = np.array(head.get("force") or (0.0, 0.0, 0.0))
        load = float(np.linalg.norm(force))
        self._arrow.SetVisibility(load > 0.02)
        if load > 0.02:
            arrow = self._pyvista.Arrow(start=centre, direction=force, scale=min(LENGTH * load, 0.06))
            self._arrow.mapper.dataset.copy_from(arrow)

    def _say(self, head: dict[str, Any]) -> None:
        if head:
            load = float(head["load"])
            stick = "" if "stick" not in head or not load > 0.0 else ", sticks" if head["stick"] else ", slips"
            self._numbers = f"{head['time']:.2f} s   {load:.2f} N   {1e3 * head['depth']:.1f} mm{stick}"
        self._text.set_text("upper_left", f"{self._numbers}\n{self._status}")
