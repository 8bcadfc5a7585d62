"""Pictures of the worst touches: forces around the worst tick, and a section of the surface with finger and feet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.geometry.mesh import Mesh
from palpate.studies.organs.report import line
from palpate.studies.organs.runs import run
from palpate.studies.organs.search import Found
from palpate.studies.organs.touches import THICKNESS
from palpate.views.pictures.style import save

AROUND = 0.03  # [s] before and after the worst tick
NEAR = 22e-3  # [m] half of the width of a section


def draw_touches(listed: Sequence[Found], meshes: Path, out: Path) -> dict[str, Path]:
    """A picture of each touch, as files by name; none where matplotlib is missing. OSError: it cannot be written."""
    try:
        from palpate.views.pictures.style import figure
    except ImportError:
        return {}
    files = {}
    for number, found in enumerate(listed):
        name = f"worst-{number + 1}"
        picture = figure(11.0, 4.8, line(found).replace(" x): ", " x)\n", 1))
        _draw_one(picture, found, meshes)
        files[name] = out / f"{name}.png"
        save(picture, files[name], dpi=110)
    return files


def _draw_one(picture: Any, found: Found, meshes: Path) -> None:
    every = run([found.touch], meshes)
    traces = max(every, key=lambda one: float(np.nan_to_num(one["contact.force"]).max()))
    values = {name: column[0, : traces.ticks[0]] for name, column in traces.values.items()}
    k = min(round(found.score.time / traces.step), len(values["contact.force"]) - 1)
    near = slice(max(0, k - round(AROUND / traces.step)), k + round(AROUND / traces.step))
    left, right = picture.subplots(1, 2)
    times = 1e3 * traces.step * np.arange(len(values["contact.force"]))[near]
    left.plot(times, values["contact.force"][near], label="contact force")
    left.plot(times, np.linalg.norm(values["controller.force"][near], axis=1), label="force on the hand")
    left.plot(times, np.linalg.norm(values["contact.lateral_force"][near], axis=1), label="lateral force")
    left.plot(times, 1e3 * values["collision.approach"][near], ":", label="approach [mm]")
    left.axvline(1e3 * traces.step * k, color="0.7", zorder=0)
    left.set(xlabel="time [ms]", ylabel="force [N]", xlim=(times[0], times[-1]))
    left.legend()
    _section(right, found.touch.setting.mesh(), values, near, k)


def _section(axes: Any, mesh: Mesh, values: dict[str, np.ndarray], near: slice, k: int) -> None:
    """The plane of the feet's normals: the surface, the tip of the bone, and the feet with their normals."""
    at, normals = values["finger.position"][k], values["contact.normal"][near]
    up = normals.mean(axis=0)
    up /= max(float(np.linalg.norm(up)), 1e-9)
    spread = np.concatenate([normals - up, (values["finger.position"][near] - at) / THICKNESS])
    spread -= np.outer(spread @ up, up)
    across = np.linalg.svd(spread + 1e-9 * np.eye(3)[0])[2][0]
    across -= up * (across @ up)
    across /= np.linalg.norm(across)
    plane = np.stack([across, up])
    for a, b in _cut(mesh, at, np.cross(across, up)):
        ends = 1e3 * (np.stack([a, b]) - at) @ plane.T
        axes.plot(*ends.T, color="0.4", linewidth=1.0)
    path, feet = (1e3 * (values[name][near] - at) @ plane.T for name in ("finger.position", "contact.foot"))
    axes.plot(*path.T, ".-", markersize=3, label="finger (edge of its bone)")
    axes.plot(*feet.T, "x", markersize=4, label="foot, with its normal")
    arrows = 4.0 * normals @ plane.T
    axes.quiver(*feet.T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, width=2e-3, alpha=0.5)
    axes.set(xlabel="mm", ylabel="mm", xlim=(-1e3 * NEAR, 1e3 * NEAR), ylim=(-1e3 * NEAR, 1e3 * NEAR), aspect="equal")
    axes.legend(loc="upper right")


def _cut(mesh: Mesh, at: np.ndarray, normal: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Segments in which the triangles near a point meet the plane through it."""
    corners = mesh.vertices[mesh.triangles]
    near = np.linalg.norm(corners.mean(axis=1) - at, axis=1) < 2.5 * NEAR
    found = []
    for triangle in corners[near]:
        side = (triangle - at) @ normal
        ends = [
            triangle[i] + (triangle[j] - triangle[i]) * (side[i] / (side[i] - side[j]))
            for i, j in ((0, 1), (1, 2), (2, 0))
            if side[i] * side[j] < 0.0
        ]
        if len(ends) == 2:
            found.append((ends[0], ends[1]))
    return found
