"""Chooses instants of a touch, and reads the deformed surface at them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from palpate.engine.imports import UntrustedError, recorded_class
from palpate.messages import Force, Surface
from palpate.messages.tissue import Support
from palpate.nodes.base import Node, SettingError
from palpate.physics.geometry.mesh import Mesh
from palpate.views.carried import STILL, Carried
from palpate.views.errors import PictureError
from palpate.views.pictures.touch import Columns, TouchStreams, together, touches
from palpate.views.shown import Bodies, links_of, moves_of
from palpate.views.surface.render import RIGHT

SHALLOWEST = 0.35  # smallest indentation of an instant, as a fraction of the deepest
LIGHTEST = 0.02  # the same for the force

PATCH = 4e-3  # [m] radius of the patch around a foot point whose mean displacement moves the drawn fingertip


@dataclass(frozen=True)
class Instant:
    """One instant of a touch by one finger or several.

    time          [s]
    surface       message of the body
    displacement  [m] (V,3)  of every vertex of the mesh, with the motion of its foundation
    tips          [m] (f,3)  lowest point of each fingertip; not finite if not recorded
    normals       [1] (f,3)  outward normal at each foot point
    forces        [N] (f,3)  on the hand
    loads         [N] (f)    normal forces
    depths        [m] (f)    indentations of the tissue
    """

    time: float
    surface: Surface
    displacement: np.ndarray
    tips: np.ndarray
    normals: np.ndarray
    forces: np.ndarray
    loads: np.ndarray
    depths: np.ndarray

    @property
    def depth(self) -> float:
        """The largest indentation [m]."""
        return float(self.depths.max())

    def title(self) -> str:
        """Time, and indentation and normal force of each finger from left to right in the picture."""
        order = np.argsort(self.tips @ RIGHT, kind="stable")
        deep = ", ".join(f"{depth * 1e3:.1f}" for depth in self.depths[order])
        loads = ", ".join(f"{load:.2f}" for load in self.loads[order])
        force = "force" if len(order) > 1 else "normal force"  # the titles of neighbours must not meet
        return f"{self.time:.2f} s:  {deep} mm deep,  {force} {loads} N"


def bodies_of(touch: TouchStreams) -> Bodies:
    """The bodies whose nodes can provide a mesh here.

    PictureError: no stream of surfaces, or no mesh of the first body.
    """
    found = Bodies.of(*links_of(touch.recording), lambda name: _mesh(touch, name), moves_of(touch.recording))
    if not found.streams:
        raise PictureError("the recording has no stream of surfaces")
    return found


def _mesh(touch: TouchStreams, name: str) -> Mesh:
    """The mesh of a node. PictureError: it has none."""
    nodes = touch.recording.about.get("plan", {}).get("nodes", ())
    node: dict[str, Any] = next((given for given in nodes if given.get("name") == name), {})
    try:
        kind = recorded_class(node["class"], Node)
        body: Any = kind(**node.get("settings", {}))
        mesh: Mesh = body.mesh()
        return mesh
    except UntrustedError as error:
        raise PictureError(f"node {name!r}: {error}") from None
    except (KeyError, ImportError, AttributeError):
        raise PictureError(f"node {name!r}: {node.get('use', 'its class')} has no mesh") from None
    except (SettingError, ValueError, OSError) as error:
        raise PictureError(f"node {name!r}: its mesh cannot be made here: {error}") from None


def displace_vertices(surface: Surface, vertices: int) -> np.ndarray:
    """Displacement [m] (V,3) of all vertices. PictureError: a vertex that is not in the mesh."""
    field = np.zeros((vertices, 3))
    if len(surface.nodes):
        if int(surface.nodes.max()) >= vertices or int(surface.nodes.min()) < 0:
            raise PictureError(f"vertex {int(surface.nodes.max())} is displaced, but the mesh has only {vertices}")
        field[surface.nodes] = surface.displacement
    return field


def choose(contact: Columns, count: int) -> list[int]:
    """Ticks of instants that differ most in depth and position, in order of time: the deepest of each touch, then
    repeatedly the one farthest from those chosen (farthest-point sampling)."""
    slices = touches(contact["time"], contact["force"])
    if not slices:
        return []
    depth, foot = contact["indentation"], contact["foot"]
    rows = np.concatenate([np.arange(touch.start, touch.stop) for touch in slices])
    deepest = max(float(depth[rows].max()), 1e-9)
    clear = (depth[rows] >= SHALLOWEST * deepest) & (contact["force"][rows] >= LIGHTEST * contact["force"].max())
    rows = rows[clear] if clear.any() else rows  # an impact on a rigid body is deepest where its force is small
    feature = np.column_stack(
        [depth / deepest, (foot - foot[rows[0]]) / max(float(np.ptp(foot[rows], axis=0).max()), 1e-2)]
    )
    # Loading and unloading look the same: the phase of the touch distinguishes them.
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


def instants(touch: TouchStreams, shown: Bodies, count: int = 6) -> list[Instant]:
    """Up to `count` instants of a touch, chosen by `choose`.

    PictureError: no contact, surface or displacement was recorded, or it does not fit the mesh.
    """
    if touch.stream_of(Surface) is None or touch.contact is None:
        raise PictureError("the recording has no contact on a surface")
    chosen = instants_at(touch, shown, choose(_all_contacts(touch), count))
    if not chosen:
        raise PictureError("nothing was touched")
    if not any(instant.surface.displacement.any() for instant in chosen):
        raise PictureError("no displacement was recorded")
    return chosen


def instants_at(touch: TouchStreams, shown: Bodies, ticks: list[int]) -> list[Instant]:
    """The instants at those of these ticks for which both contact and surface were recorded.

    PictureError: no contact or surface was recorded, or it does not fit the mesh.
    """
    if touch.stream_of(Surface) is None or touch.contact is None:
        raise PictureError("the recording has no contact on a surface")
    by_body = {stream: touch.at(Surface, ticks, stream) for stream in shown.streams}
    at = np.intersect1d(list(by_body[shown.streams[0]]), touch.contact["tick"])
    time = _at(at, touch.contact, "time", 0.0)
    motions = {stream: touch.at(Support, ticks, stream) for stream in dict.fromkeys(shown.supports) if stream}
    by_finger = [_finger(each, at) for each in touch.fingers]
    feet, tips, normals, forces, loads, depths, nearest = (
        np.stack(columns, 1) for columns in zip(*by_finger, strict=True)
    )
    moments = []
    for k, tick in enumerate(at.tolist()):
        surface = shown.surface({stream: found[tick] for stream, found in by_body.items() if tick in found})
        assert surface is not None  # contains the first body
        field = displace_vertices(surface, len(shown.mesh.vertices))
        along = mean_drag(shown.mesh.vertices, field, feet[k], normals[k]) * (loads[k] > 0.0)[:, None]
        for first, end, moved in shown.carried({s: found[tick] for s, found in motions.items() if tick in found}):
            rest, part = shown.mesh.vertices[first:end], field[first:end]  # a view
            part[:] = moved.points(rest + part) - rest if moved.turn else part + moved.way
        frames = [
            _frame(finger.motions, int(organ), motions, tick)
            for finger, organ in zip(touch.fingers, nearest[k], strict=True)
        ]
        ends = np.array([frame.points(tip) for frame, tip in zip(frames, tips[k] + along, strict=True)])
        out, pushes = (
            np.array([frame.vectors(one) for frame, one in zip(frames, each, strict=True)])
            for each in (normals[k], forces[k])
        )
        moments.append(Instant(float(time[k]), surface, field, ends, out, pushes, loads[k], depths[k]))
    return moments


def mean_drag(vertices: np.ndarray, displacement: np.ndarray, feet: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Mean displacement [m] (f,3) along the surface of the vertices around each foot point (f,3), normals (f,3).

    The contact and its load are computed at the foot point on the undeformed surface. Friction moves this point, so a
    fingertip drawn at the device's position would be next to its indentation.
    """
    away = np.linalg.norm(vertices - feet[:, None], axis=2)
    around = away <= away.min(axis=1, keepdims=True) + PATCH
    moved = (around @ displacement) / np.maximum(around.sum(axis=1, keepdims=True), 1)
    along: np.ndarray = moved - (moved * normals).sum(axis=1, keepdims=True) * normals
    return along


def _finger(touch: TouchStreams, at: np.ndarray) -> list[np.ndarray]:
    """Foot point, tip, normal, force on the hand (n,3), normal force, indentation and index of the nearest organ (n) of
    a finger at ticks (n)."""
    contact, nowhere, tips = touch.contact, (np.nan, np.nan, np.nan), _tips(touch)
    return [
        _at(at, contact, "foot", nowhere),
        _at(at, tips, "tip", nowhere),
        _at(at, contact, "normal", (0.0, 0.0, 1.0)),
        _at(at, touch[Force], "force", (0.0, 0.0, 0.0)),
        _at(at, contact, "force", 0.0),
        _at(at, contact, "indentation", 0.0),
        _at(at, tips, "organ", 0),
    ]


def _frame(supports: list[str], organ: int, motions: dict[str, dict[int, Any]], tick: int) -> Carried:
    """The motion of the organ under a finger, whose motions are those of these streams."""
    support = motions.get(supports[organ], {}).get(tick) if organ < len(supports) else None
    return Carried.by(support) if support is not None else STILL


def _at(at: np.ndarray, columns: Columns | None, name: str, absent: Any) -> np.ndarray:
    """A column at ticks (n), with a value for those that were not recorded."""
    values = np.full((len(at), *np.shape(absent)), absent)
    if columns is not None:
        _, here, there = np.intersect1d(at, columns["tick"], return_indices=True)
        values[here] = columns[name][there]
    return values


def _all_contacts(touch: TouchStreams) -> Columns:
    """The contact of a finger; of several the sum of their forces, the greatest indentation and all foot points."""
    every = [each.contact for each in touch.fingers if each.contact is not None]
    if len(every) == 1:
        return every[0]
    rows = together(*every)
    return {
        "tick": rows[0]["tick"],
        "time": rows[0]["time"],
        "force": np.sum([row["force"] for row in rows], axis=0),
        "indentation": np.max([row["indentation"] for row in rows], axis=0),
        "foot": np.concatenate([row["foot"] for row in rows], axis=1),
    }


def _tips(touch: TouchStreams) -> Columns | None:
    """End of the compressed fingertip: gap - h0 + s1 (in contact -s2) above the foot point on the nearest organ, in the
    frame of this organ, the index of which is `organ`."""
    if touch.contact is None or not touch.near:
        return None
    contact, *organs = together(touch.contact, *touch.near)
    nearest = np.argmin([near["gap"] for near in organs], axis=0)
    rows = np.arange(len(nearest))
    gap, approach, foot, normal = (
        np.array([near[name] for near in organs])[nearest, rows] for name in ("gap", "approach", "foot", "normal")
    )
    if not (approach > 0.0).any():
        return None
    thickness = float(np.median((gap + approach)[approach > 0.0]))
    tip = foot + (gap - thickness + contact["compression"])[:, None] * normal
    return {"tick": contact["tick"], "tip": tip, "organ": nearest}
