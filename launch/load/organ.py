"""Replaces the organ of a scene by one of a file, placed where the scene's hand touches it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.engine.faults import Location
from palpate.launch.load.files import Override
from palpate.launch.load.labelled.table import tissue_of
from palpate.launch.load.values.source import YamlSource
from palpate.messages import Vector3
from palpate.nodes.base.bone import WithBone
from palpate.nodes.base.surface import REFINE, OnSurface, Placed, rotation_matrix, surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.geometry.mesh import Mesh, heights, summit
from palpate.physics.segmentation.endings import JOIN, ON

if TYPE_CHECKING:
    from palpate.engine.graph import Graph
    from palpate.launch.load.labelled.bone import RigidBone
    from palpate.launch.load.labelled.nodule import Nodule
    from palpate.launch.load.organ_file import OrganFile

FINGER = 8e-3  # [m] radius around the top of the organ that must support the finger
STEEPEST = 10e-3
"""[m] Largest difference in height between the organ and the scene's surface under the hand's path."""
SCALES = tuple(k / 10 for k in range(10, -1, -1))
"""[1] Horizontal scales of the path, in order: the first for which the organ lies under the whole path is used."""
POSITION = "scene.surface.position"
BETWEEN = 5  # points checked between two points of the path


def place_organ(
    read: Callable[[Sequence[str | Override]], Graph], overrides: Sequence[str | Override], organ: OrganFile,
    follow: bool = True,
) -> tuple[list[Override], tuple[str, ...]]:  # fmt: skip
    """Overrides that replace the organ of a scene by this one, before those of the user, and notes: on a segmentation,
    and on the position.

    The top of the organ moves to the point where the hand's path first touches the scene's surface. Each point of the
    path is raised or lowered by the difference in height of the two surfaces, so that the indentation stays the same.
    If the organ is too small or too steep, the path is scaled down horizontally. The scene's rotation is kept.

    read       the graph with these overrides
    overrides  of the user
    follow     change the path of the hand; False: the motion is recorded, so only the organ moves

    MeshError: a graph without a surface and a hand, a segmentation that cannot be used. SettingError: the mesh is
    unusable.
    """
    given_as, labelled = organ.file, organ.labelled()
    organ, made = organ.as_mesh()
    # Settings of the user's surface apply to the organ; the path was written for the scene's surface without them.
    unit, piece = organ.in_unit(), organ.setting
    turned = read(overrides)
    graph = read([o for o in overrides if not _names([o], "scene.surface")])
    scene = graph.scene
    node = next((n for n in graph.nodes.values() if issubclass(n.cls, Placed) and "thickness" in n.settings), None)
    surface = scene.get("surface")
    if node is None or not isinstance(surface, dict) or "surface" not in surface:
        raise MeshError(
            f"--organ: {graph.path.stem} has no scene.surface that a finger collides with; take a graph such as kidney"
        )
    given = node.settings
    refine = next((n.settings["refine"] for n in turned.nodes.values() if issubclass(n.cls, OnSurface)), REFINE)
    rotation = _vector(turned.nodes[node.name].settings["rotation"])
    mesh = surface_mesh(str(organ.file), 0, rotation=rotation, file_unit=unit, piece=piece, refine=refine)
    count = next((n.settings["vertices"] for n in graph.nodes.values() if issubclass(n.cls, OnSurface)), 3000)
    position = _vector(given["position"]), _vector(given["rotation"])
    original = surface_mesh(given["surface"], count, *position, given.get("file_unit", "m"))
    points, path = _path(graph)
    touching = heights(original, points[:, :2]) + given["thickness"] > points[:, 2]
    anchor = points[np.argmax(touching), :2] if touching.any() else summit(original, FINGER)[:2]
    top = summit(mesh, FINGER)
    moved = np.array([*anchor, heights(original, anchor[None])[0]]) - top
    values: dict[tuple[str, ...], Any] = {
        ("scene", "surface"): surface
        | {"surface": str(organ.file.absolute()), "file_unit": unit, "piece": piece, "position": moved.tolist()},
        (node.name, "use"): "collision.Mesh",
    }
    size = " x ".join(f"{1e3 * side:.3g}" for side in np.ptp(mesh.vertices, axis=0))
    lies = ", ".join(f"{1e3 * v:.3g}" for v in top + moved)
    name = str(given_as) if made else f"{given_as} in {unit}"
    text = f"{name}: {size} mm, {len(mesh.vertices)} vertices; its top lies at ({lies}) mm"
    if path and follow:
        scale, points = _follow(Mesh(mesh.vertices + moved, mesh.triangles), original, points, anchor)
        values["scene", "hand"] = scene["hand"] | _hand(path, points)
        narrower = f", {100 * scale:.0f} % as wide as on {Path(given['surface']).name}" if scale < 1.0 else ""
        text += f", and the hand's path follows it{narrower}"
    if labelled.parts:
        at = _vector(turned.nodes[node.name].settings["position"] if _names(overrides, POSITION) else moved)
        placed = Mesh(mesh.vertices + at, mesh.triangles)
        for part in labelled.parts:
            taken, more = _take_part(turned, part, placed, rotation, at)
            values, made = values | taken, (*made, *more)
    label = labelled.name
    if (tissue := tissue_of(label)) and not _names(overrides, "scene.tissue"):
        made = (*made, f"label {label} has the tissue of the scene; published: --set scene.tissue={tissue}")
    place = Location(f"--organ {given_as}")
    return [Override(keys, YamlSource(value, {(): place})) for keys, value in values.items()], (*made, text)


def _take_part(
    graph: Graph, part: Nodule | RigidBone, mesh: Mesh, rotation: Vector3, position: Vector3
) -> tuple[dict[tuple[str, ...], Any], tuple[str, ...]]:
    """The settings of a nodule in an organ at this place, in the scene's part `nodule` or on the bodies that have one,
    or of bone next to it, and notes. MeshError: no body has them."""
    found, notes = part.settings(mesh, rotation_matrix(rotation), np.array(position))
    if isinstance(graph.scene.get("nodule"), dict) and graph.scene["nodule"].keys() >= found.keys():
        return {("scene", "nodule", key): value for key, value in found.items()}, notes
    bodies = [name for name, node in graph.nodes.items() if issubclass(node.cls, WithBone)]
    if not bodies:
        raise MeshError(
            f"--label: no body of {graph.path.stem} has a nodule or bone; take MassSpring, or a label without `{JOIN}` "
            f"and `{ON}`"
        )
    return {(body, key): value for body in bodies for key, value in found.items()}, notes


def _names(overrides: Sequence[str | Override], target: str) -> bool:
    """Whether the user sets this value of the scene, or one of its parts."""
    keys = [o.partition("=")[0].strip() if isinstance(o, str) else ".".join(o.keys) for o in overrides]
    return any(f"{key}.".startswith(f"{target}.") for key in keys)


def _vector(given: Any) -> Vector3:
    x, y, z = given
    return (x, y, z)


def _path(graph: Graph) -> tuple[np.ndarray, list[dict[str, Any]]]:
    """Start of the scene's hand and ends of its segments [m] (n + 1,3), and the segments; empty without a hand."""
    hand = graph.scene.get("hand")
    holder = next((n.settings for n in graph.nodes.values() if {"begin", "path"} <= n.settings.keys()), None)
    if holder is None or not isinstance(hand, dict) or not holder["path"]:
        return np.zeros((0, 3)), []
    points = [holder["begin"]]
    for segment in holder["path"]:
        points.append(segment["to"] or points[-1])
    return np.array(points, dtype=float), holder["path"]


def _follow(organ: Mesh, original: Mesh, points: np.ndarray, anchor: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and points (n,3) [m] of the path over the organ; horizontal distances from the anchor (2) are scaled."""
    steps = np.linspace(0.0, 1.0, BETWEEN + 1)[1:, None, None]
    dense = (points[:-1] + steps * (points[1:] - points[:-1])).reshape(-1, 3)[:, :2]
    under, scale = heights(original, dense), 0.0
    for scale in SCALES:
        away = np.abs(heights(organ, anchor + scale * (dense - anchor)) - under)
        if (np.isnan(under) | (away < STEEPEST)).all():
            break
    across = anchor + scale * (points[:, :2] - anchor)
    raised = points[:, 2] + np.nan_to_num(heights(organ, across) - heights(original, points[:, :2]))
    return scale, np.column_stack([across, raised])


def _hand(path: list[dict[str, Any]], points: np.ndarray) -> dict[str, Any]:
    """`begin` and `path` of a hand through these points, with the times of the given path."""
    segments = []
    for segment, point in zip(path, points[1:], strict=True):
        kept = {key: value for key, value in segment.items() if value is not None}
        segments.append(kept | {"to": point.tolist()} if "to" in kept else kept)
    return {"begin": points[0].tolist(), "path": segments}
