"""Runs VTK in a subprocess, and reports why it may fail on a machine."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.scratch import ScratchFolder
from palpate.views.errors import PictureError
from palpate.views.pictures.style import deformation_table
from palpate.views.surface.moments import Instant
from palpate.views.surface.render import ball_centres

PATIENCE, EACH = 60.0, 2.0  # [s] timeout: a base value, and a share per picture
WINDOWS = ("", "vtkOSOpenGLRenderWindow")
"""Render windows of VTK, in order: its default, which is EGL without a display; then OSMesa."""
CURE = "install Mesa's off-screen drawing (Debian: apt install libosmesa6, or libegl1 libgl1-mesa-dri)"


class Rendering:
    """Renders instants of a touch in a subprocess, which starts at once.

    values   (V) colour values of the vertices, for each instant
    near     indices of the instants that also get a close-up
    most     end of the colour scale
    all_of   instants whose fingers and forces determine camera and arrows; default: the rendered ones
    """

    def __init__(
        self, mesh: Any, instants: Sequence[Instant], values: Sequence[np.ndarray], near: Sequence[int], most: float,
        all_of: Sequence[Instant] | None = None,
    ) -> None:  # fmt: skip
        self._folder = ScratchFolder("view")
        self._source, self._target = (Path(self._folder.name) / name for name in ("views.npz", "pixels.npz"))
        scene = instants if all_of is None else all_of
        tips, normals, forces = (
            np.concatenate([getattr(one, name) for one in scene]) for name in ("tips", "normals", "forces")
        )
        np.savez(
            self._source,
            vertices=mesh.vertices,
            triangles=mesh.triangles,
            displacement=np.array([one.displacement for one in instants], dtype=np.float32),
            values=np.array(values, dtype=np.float32),
            tips=np.array([one.tips for one in instants]),
            normals=np.array([one.normals for one in instants]),
            forces=np.array([one.forces for one in instants]),
            near=np.array(near, dtype=np.int64),
            most=most,
            colours=deformation_table(),
            balls=ball_centres(tips, normals),
            pulls=forces[np.isfinite(tips + normals).all(axis=1)],
            greatest=float(np.linalg.norm(forces, axis=1).max()),
        )
        self._patience = PATIENCE + EACH * (len(instants) + len(near))
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
        """Wait for the pictures. PictureError: this machine cannot render them."""
        for following in (*WINDOWS[1:], None):
            try:
                _, errors = self._process.communicate(timeout=self._patience)
            except subprocess.TimeoutExpired:
                raise PictureError(
                    f"no 3-D picture within {self._patience:.0f} s: if this machine is busy, draw it later with "
                    f"`palpate picture FILE`; else {CURE}"
                ).as_failure() from None
            if self._process.returncode == 0 and self._target.is_file():
                with np.load(self._target) as archive:
                    return dict(archive)
            if following is not None:
                self._process = self._begin(following)
        raise PictureError(
            f"no 3-D picture: {_reason(self._process.returncode, errors.decode(errors='replace'))}; {CURE}"
        ).as_failure()

    def close(self) -> None:
        if self._process.poll() is None:
            self._process.kill()
        with contextlib.suppress(ValueError):
            self._process.communicate()
        self._folder.cleanup()


def _reason(code: int, errors: str) -> str:
    """The last line of a process's output, or how it ended."""
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    if code < 0:
        return f"VTK's drawing process was ended by signal {-code}"
    return lines[-1][:200] if lines else f"VTK's drawing process ended with exit code {code}"
