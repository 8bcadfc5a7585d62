"""The deformed surface at several instants, coloured by how far it moved."""

from __future__ import annotations

import contextlib
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.launch.pictures.moments import Instant, instants, surface_mesh
from palpate.launch.pictures.style import DEFORMATION, figure
from palpate.launch.pictures.touch import Touch
from palpate.physics.errors import PalpateError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NAME = "deformation"
TITLE = "The surface under the finger  (ball: fingertip; arrow: force on the hand)"
COUNT, COLUMNS = 6, 3
PATIENCE = 60.0  # [s]
WINDOWS = ("", "vtkOSOpenGLRenderWindow")
"""What VTK draws into: its own choice, which is EGL where there is no display; then OSMesa."""
CURE = "install Mesa's off-screen drawing (Debian: apt install libosmesa6, or libegl1 libgl1-mesa-dri)"


class NoRendering(PalpateError, RuntimeError):
    """Why no 3-D picture can be drawn on this machine, and what to install."""


class Views:
    """Drawing of the surface in a process of its own, begun when this is made."""

    def __init__(self, touch: Touch) -> None:
        mesh = surface_mesh(touch)
        self.instants: list[Instant] = instants(touch, len(mesh.vertices), COUNT)
        count = len(self.instants)
        self.columns = min(COLUMNS, count)
        self.near = sorted(sorted(range(count), key=lambda i: -self.instants[i].depth)[: self.columns])
        lengths = np.array([np.linalg.norm(one.displacement, axis=1).max() for one in self.instants])
        self.deepest = _round_up(float(lengths.max()))
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-")
        self._source, self._target = (Path(self._folder.name) / name for name in ("views.npz", "pixels.npz"))
        nowhere = np.full(3, np.nan)
        np.savez(
            self._source,
            vertices=mesh.vertices,
            triangles=mesh.triangles,
            displacement=np.array([one.displacement for one in self.instants], dtype=np.float32),
            tips=np.array([nowhere if one.tip is None else one.tip for one in self.instants]),
            normals=np.array([one.normal for one in self.instants]),
            forces=np.array([one.force for one in self.instants]),
            near=np.array(self.near),
            deepest=self.deepest,
        )
        self._process = self._begin(WINDOWS[0])

    def _begin(self, window: str) -> subprocess.Popen:
        environment = {key: value for key, value in os.environ.items() if key != "DISPLAY"}
        if window:
            environment["VTK_DEFAULT_OPENGL_WINDOW"] = window
        command = [sys.executable, "-m", f"{__package__}.render", str(self._source), str(self._target)]
        return subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )

    def pixels(self) -> dict[str, np.ndarray]:
        """Wait for the pictures. NoRendering: this machine cannot draw them."""
        for following in (*WINDOWS[1:], None):
            try:
                _, errors = self._process.communicate(timeout=PATIENCE)
            except subprocess.TimeoutExpired:
                raise NoRendering(f"no 3-D picture within {PATIENCE:.0f} s; {CURE}") from None
            if self._process.returncode == 0 and self._target.is_file():
                with np.load(self._target) as found:
                    return dict(found)
            if following is not None:
                self._process = self._begin(following)
        raise NoRendering(
            f"no 3-D picture: {_reason(self._process.returncode, errors.decode(errors='replace'))}; {CURE}"
        )

    def close(self) -> None:
        """End the process, remove the files."""
        if self._process.poll() is None:
            self._process.kill()
        with contextlib.suppress(ValueError):
            self._process.communicate()
        self._folder.cleanup()

    def draw(self) -> Figure:
        """The figure. NoRendering: this machine cannot draw it."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LinearSegmentedColormap, Normalize

        pixels = self.pixels()
        columns = self.columns
        rows = -(-len(self.instants) // columns)
        out = figure(
            4.2 * columns + 1.0,
            2.6 * rows + 3.3,
            TITLE,
        )
        grid = out.subplots(rows + 1, columns, squeeze=False, height_ratios=[1.0] * rows + [1.22])
        for axes in grid.ravel():
            axes.set_axis_off()
        for i, one in enumerate(self.instants):
            axes = grid[i // columns][i % columns]
            axes.imshow(pixels["wide"][i])
            axes.set_title(_title(one), fontsize=11, loc="center")
        for axes, i, picture in zip(grid[rows], self.near, pixels["close"], strict=True):
            axes.imshow(picture)
            axes.set_title(f"the same at {self.instants[i].time:.2f} s, near", fontsize=11, loc="center")
        colours = LinearSegmentedColormap.from_list("deformation", DEFORMATION)
        scale = ScalarMappable(Normalize(0.0, self.deepest * 1e3), colours)
        bar = out.colorbar(scale, ax=grid, shrink=0.6, aspect=32, pad=0.015)
        bar.set_label("displacement of the surface [mm]")
        bar.outline.set_visible(False)
        return out


def _title(one: Instant) -> str:
    return f"{one.time:.2f} s:  {one.depth * 1e3:.1f} mm deep,  {one.load:.2f} N"


def _round_up(length: float) -> float:
    """The next full millimetre up to 20 mm; below 1 mm and above 20 mm the next of 1, 2, 5, 10 in its decade."""
    if 1e-3 < length <= 20e-3:
        return math.ceil(length * 1e3 - 1e-6) / 1e3
    if length <= 0.0:
        return 1e-3
    decade = 10.0 ** math.floor(math.log10(length))
    return float(next(step for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= length * (1 - 1e-9)) * decade)


def _reason(code: int, errors: str) -> str:
    """The last line that a process said, or how it ended."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if code < 0:
        return f"VTK's drawing process was ended by signal {-code}"
    return lines[-1][:200] if lines else f"VTK's drawing process ended with exit code {code}"
