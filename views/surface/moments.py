"""Which instants of a touch to show, and how the surface was deformed then."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.engine.imports import UntrustedError, recorded_class
from palpate.messages import Surface
from palpate.nodes.base import Node, SettingError
from palpate.nodes.base.surface import complete
from palpate.views.pictures import PictureError
from palpate.views.pictures.touch import Columns, TouchStreams, together, touches

SHALLOWEST = 0.35
"""Instants with less than this share of the deepest indentation show hardly anything."""


@dataclass(frozen=True)
class Instant:
    """One instant of a touch.

    time          [s]
    surface       message of the body
    displacement  [m] (V,3)  of every vertex of the mesh
    tip           [m] (3)    lowest point of the fingertip, None where the recording has none
    normal        [1] (3)    outward normal at the foot point
    force         [N] (3)    on the hand
    load          [N]        normal force
    depth         [m]        indentation of the tissue
    """

    time: float
    surface: Surface
    displacement: np.ndarray
    tip: np.ndarray | None
    normal: np.ndarray
    force: np.ndarray
    load: float
    depth: float


def surface_mesh(touch: TouchStreams) -> Any:
    """The undeformed mesh on which the body that sent the surface was built: its node makes it again.

    PictureError: no surface stream, a body without a mesh, or one that cannot be made here.
    """
    stream = touch.recording.stream_of(Surface)
    if stream is None:
        raise PictureError("the recording has no stream of surfaces")
    node = touch.node(stream)
    try:
        kind = recorded_class(node["class"], Node)
        body = kind(**node.get("settings", {}))
        return body.mesh()
    except UntrustedError as error:
        raise PictureError(f"stream {stream!r}: {error}") from None
    except (KeyError, ImportError, AttributeError):
        raise PictureError(f"stream {stream!r}: {node.get('use', 'its sender')} has no mesh") from None
    except (SettingError, ValueError, OSError) as error:
        raise PictureError(f"stream {stream!r}: its mesh cannot be made here: {error}") from None


def displaced(surface: Surface, vertices: int) -> np.ndarray:
    """Displacement [m] (V,3) of all vertices from the sparse form. PictureError: a vertex that the mesh lacks."""
    field = np.zeros((vertices, 3))
    if len(surface.nodes):
        if int(surface.nodes.max()) >= vertices or int(surface.nodes.min()) < 0:
            raise PictureError(f"vertex {int(surface.nodes.max())} is displaced, but the mesh has only {vertices}")
        field[surface.nodes] = surface.displacement
    return field


def choose(contact: Columns, count: int) -> list[int]:
    """Ticks of instants that differ most in depth and place, in order of time: the deepest of each touch first, then
    those farthest from all that were chosen."""
    slices = touches(contact["time"], contact["force"])
    if not slices:
        return []
    depth, foot = contact["indentation"], contact["foot"]
    rows = np.concatenate([np.arange(touch.start, touch.stop) for touch in slices])
    deepest = max(float(depth[rows].max()), 1e-9)
    rows = rows[depth[rows] >= SHALLOWEST * deepest]
    feature = np.column_stack(
        [depth / deepest, (foot - foot[rows[0]]) / max(float(np.ptp(foot[rows], axis=0).max()), 1e-2)]
    )
    # The way in and the way out look alike: the phase of the touch tells them apart.
    phase = np.zeros(len(depth))
    for i, touch in enumerate(slices):
        phase[touch] = i + np.linspace(0.0, 1.0, touch.stop - touch.start)
    feature = np.column_stack([feature, 0.5 * phase])
    peaks = [touch.start + int(depth[touch].argmax()) for touch in slices]
    chosen = sorted(peaks, key=lambda row: -depth[row])[: max(1, count // 2)]
    while len(chosen) < min(count, len(rows)):
        away = np.min([np.linalg.norm(feature[rows] - feature[row], axis=1) for row in chosen], axis=0)
        chosen.append(int(rows[away.argmax()]))
    return [int(contact["tick"][row]) for row in sorted(set(chosen))]


def instants(touch: TouchStreams, points: np.ndarray, count: int = 6) -> list[Instant]:
    """Up to `count` instants of a mesh with these vertices [m] (V,3).

    PictureError: no contact, surface or displacement was recorded, or it does not fit the mesh.
    """
    if touch.recording.stream_of(Surface) is None or touch.contact is None:
        raise PictureError("the recording has no contact on a surface")
    chosen = instants_at(touch, points, choose(touch.contact, count))
    if not chosen:
        raise PictureError("nothing was touched")
    if not any(instant.displacement.any() for instant in chosen):
        raise PictureError("no displacement was recorded")
    return chosen


def instants_at(touch: TouchStreams, points: np.ndarray, ticks: list[int]) -> list[Instant]:
    """The instants at these ticks, as far as both contact and surface were recorded there.

    PictureError: no contact or surface was recorded, or it does not fit the mesh.
    """
    if touch.recording.stream_of(Surface) is None or touch.contact is None:
        raise PictureError("the recording has no contact on a surface")
    rows = {int(tick): row for row, tick in enumerate(touch.contact["tick"])}
    tips = _tips(touch)
    forces = {} if touch.force is None else dict(zip(touch.force["tick"].tolist(), touch.force["force"], strict=True))
    moments = []
    for tick, surface in touch.at(Surface, ticks).items():
        if tick not in rows:
            continue
        row = rows[tick]
        surface = complete(surface, points)
        contact = {name: values[row] for name, values in touch.contact.items()}
        moments.append(
            Instant(
                time=float(contact["time"]),
                surface=surface,
                displacement=displaced(surface, len(points)),
                tip=tips.get(tick),
                normal=contact["normal"],
                force=forces.get(tick, np.zeros(3)),
                load=float(contact["force"]),
                depth=float(contact["indentation"]),
            )
        )
    return moments


def _tips(touch: TouchStreams) -> dict[int, np.ndarray]:
    """By tick, where the compressed fingertip ends: gap - h0 + s1 above the foot point, which is -s2 in contact."""
    if touch.contact is None or touch.proximity is None:
        return {}
    contact, near = together(touch.contact, touch.proximity)
    touching = near["approach"] > 0.0
    if not touching.any():
        return {}
    thickness = float(np.median((near["gap"] + near["approach"])[touching]))
    height = near["gap"] - thickness + contact["compression"]
    tips = near["foot"] + height[:, None] * near["normal"]
    return dict(zip(near["tick"].tolist(), tips, strict=True))
