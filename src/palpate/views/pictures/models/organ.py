"""An organ of a file: its surface in three planes over the segmentation, its size, where the finger does not fit."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.launch.load.organ_file import OrganFile
from palpate.nodes.base.felt import WIDTH
from palpate.nodes.base.surface import LEVEL, REFINE, surface_mesh
from palpate.physics.errors import MeshError
from palpate.physics.geometry.felt.bridge import Felt, close_surface
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.segmentation.backing import Bone
from palpate.physics.segmentation.endings import ending_of
from palpate.physics.segmentation.image import LabelImage, Segment
from palpate.physics.segmentation.inclusion import Inclusion, choose_organ
from palpate.physics.segmentation.isosurface import enclosed_volume
from palpate.physics.segmentation.read import read_labels
from palpate.views.pictures.style import FINGER, NORMAL, REGION_A, REGION_B, TISSUE, figure, look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 2000  # vertices at which the thickness is measured
STEP, LEAST_STEP, DEEPEST = 0.3e-3, 0.05e-3, 60e-3  # [m] first and least step, and end, of the search inwards
LEAST = 0.005  # [1] Quantile of the thicknesses that is shown: at a sharp edge the thickness is 0
MARGIN = 4e-3  # [m] around the organ
NAMES = (("front", "head", "seen from the right"), ("right", "head", "seen from the front"),
         ("right", "front", "seen from the head"))  # fmt: skip
OF_MESH = (("y", "z", ""), ("x", "z", ""), ("x", "y", ""))


@dataclass(frozen=True)
class Shown:
    """What the picture shows of an organ.

    mesh       [m] that is touched, refined
    felt       where the finger does not enter; None: it touches everything, or this is unknown
    thickness  [m] smallest, and its place [m] (3)
    image      the segmentation and the segment; None: the organ is a mesh file
    nodule     label inside of the organ, as a sphere; None: the label names none
    bone       labels of bone next to it; None: the label names none
    """

    name: str
    mesh: Mesh
    felt: Felt | None
    thickness: tuple[float, np.ndarray]
    image: tuple[LabelImage, Segment] | None
    notes: tuple[str, ...]
    nodule: Inclusion | None = None
    bone: Bone | None = None


def describe_organ(organ: OrganFile, width: float = WIDTH) -> Shown:
    """Read an organ as a run does. MeshError, SettingError: it cannot be used."""
    as_mesh, notes = organ.as_mesh()
    mesh, given = (
        surface_mesh(str(as_mesh.file), 0, LEVEL, LEVEL, as_mesh.in_unit(), as_mesh.setting, refine)
        for refine in (REFINE, 0.0)
    )
    image = None
    if ending_of(organ.file):
        labels = read_labels(organ.file)
        image = choose_organ(labels, organ.label)[:2]
    try:
        felt = close_surface(mesh, 0.5 * width, given=given)
    except (MeshError, ImportError) as error:
        felt, notes = None, (*notes, f"it is not known where the finger does not fit: {error}")
    _, nodule, bone = organ.labelled()
    inside, rigid = nodule and nodule.sphere, bone and bone.bone
    return Shown(str(organ.file), mesh, felt, _thickness(mesh), image, notes, inside, rigid)


def _thickness(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Smallest distance [m] along the inward normal to the other side, and its place, except for `LEAST` of them."""
    chosen = np.linspace(0, len(mesh.vertices) - 1, min(SAMPLES, len(mesh.vertices))).astype(int)
    points, inwards = mesh.vertices[chosen], -mesh.normals[chosen]
    closest = MeshClosestPoint(mesh)
    found, depth = np.full(len(chosen), np.inf), np.full(len(chosen), STEP)
    inside = np.arange(len(chosen))
    while len(inside):  # each step is as long as the distance to the surface: it cannot pass through it
        away = closest.find(points[inside] + depth[inside, None] * inwards[inside])[3]
        out = away > -LEAST_STEP
        found[inside[out]] = depth[inside[out]]
        depth[inside] += np.maximum(-away, LEAST_STEP)
        inside = inside[~out & (depth[inside] < DEEPEST)]
    order = np.argsort(found)
    place = order[int(LEAST * len(order))]
    return float(found[place]), points[place]


def rows(shown: Shown) -> dict[str, Any]:
    """The numbers of the picture, in SI units."""
    thin, place = shown.thickness
    found = {
        "volume m3": enclosed_volume(shown.mesh), "area m2": float(shown.mesh.areas.sum()),
        "sides m": np.ptp(shown.mesh.vertices, axis=0).tolist(), "vertices": len(shown.mesh.vertices),
        "smallest thickness m": thin if np.isfinite(thin) else None, "at m": place.tolist(),
    }  # fmt: skip
    if shown.image is not None:
        found["volume of the voxels m3"] = shown.image[0].volume(shown.image[1])
    if shown.nodule is not None:
        found |= {"nodule radius m": shown.nodule.radius, "nodule at m": list(shown.nodule.centre)}
    if shown.bone is not None:
        found |= {"bone": shown.bone.name, "bone distance m": shown.bone.distance}
    if shown.felt is not None:
        found |= {"bridged m2": shown.felt.area, "bridge m": shown.felt.depth, "bridge at m": shown.felt.place.tolist()}
    return found


@look()
def draw_organ(shown: Shown, width: float, path: Path) -> Path:
    """Write the picture. OSError: not possible."""
    label = f", label {shown.image[1]}" if shown.image else ""
    out = figure(11.0, 9.0, f"{Path(shown.name).name}{label}")
    save(_fill(out, shown, width), path)
    return path


def _fill(out: Figure, shown: Shown, width: float) -> Figure:
    from matplotlib.patches import Circle

    panels = out.subplots(2, 2).ravel()
    corners = shown.mesh.vertices[shown.mesh.triangles]
    weight = np.linalg.norm(shown.mesh.face_vectors, axis=1)
    middle = weight @ corners.mean(axis=1) / weight.sum()
    low, high = shown.mesh.vertices.min(axis=0) - MARGIN, shown.mesh.vertices.max(axis=0) + MARGIN
    for axis, axes in enumerate(panels[:3]):
        across, up = (k for k in range(3) if k != axis)
        right, above, seen = (NAMES if shown.image else OF_MESH)[axis]
        if shown.image is not None:
            _voxels(axes, *shown.image, axis, middle, low, high)
        if shown.felt is not None:
            _draw_section(axes, shown.felt.mesh, axis, middle, FINGER, 2.6, f"felt by a finger of {1e3 * width:.3g} mm")
        _draw_section(axes, shown.mesh, axis, middle, TISSUE, 1.2, "surface")
        axes.plot(*1e3 * shown.thickness[1][[across, up]], "v", color=NORMAL, markersize=6, label="thinnest place")
        if shown.nodule is not None:
            centre, radius = 1e3 * np.array(shown.nodule.centre), 1e3 * shown.nodule.radius
            axes.add_patch(
                Circle((centre[across], centre[up]), radius, fill=False, color=FINGER, ls="--", label="nodule")
            )
        axes.set(xlim=1e3 * np.array([low[across], high[across]]), ylim=1e3 * np.array([low[up], high[up]]),
                 xlabel=f"{right} [mm]", ylabel=f"{above} [mm]", aspect="equal",
                 title=f"{seen}, through {1e3 * middle[axis]:.1f} mm".lstrip(", "))  # fmt: skip
    panels[3].axis("off")
    known = [dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True)) for axes in panels[:3]]
    marks = known[0] | known[1] | known[2]  # a plane may miss another label
    panels[3].legend(marks.values(), marks.keys(), fontsize=9, loc="lower left")
    panels[3].text(0.0, 1.0, _text(shown, width), va="top", wrap=True, fontsize=10, linespacing=1.5)
    return out


def _voxels(
    axes: Axes, image: LabelImage, segment: Segment, axis: int, at: np.ndarray, low: np.ndarray, high: np.ndarray
) -> None:
    """Fill the voxels of the segment and of other labels in a plane."""
    from matplotlib.colors import ListedColormap

    step = 0.25 * float(image.spacing.min())
    across, up = (k for k in range(3) if k != axis)
    lines = [np.arange(low[k], high[k], step) for k in (across, up)]
    points = np.empty((len(lines[0]), len(lines[1]), 3))
    points[..., axis] = at[axis]
    points[..., across], points[..., up] = np.meshgrid(*lines, indexing="ij")
    index = np.rint((points - image.affine[:, 3]) @ np.linalg.inv(image.affine[:, :3]).T).astype(int)
    shape = image.layers.shape[1:]
    within = ((index >= 0) & (index < shape)).all(axis=-1)
    i, j, k = np.moveaxis(np.clip(index, 0, np.array(shape) - 1), -1, 0)
    values = np.where(within, image.layers[segment.layer][i, j, k], 0)
    kind = np.where(values == segment.value, 1.0, np.where(values > 0, 2.0, np.nan))
    ends = [1e3 * end for line in lines for end in (line[0], line[-1])]
    axes.imshow(kind.T, origin="lower", extent=tuple(ends), cmap=ListedColormap([REGION_A, REGION_B]), vmin=1, vmax=2,
                interpolation="nearest", aspect="equal")  # fmt: skip
    axes.grid(False)
    for colour, name in ((REGION_A, "voxels of the label"), (REGION_B, "other labels"))[: 1 + (kind == 2.0).any()]:
        axes.fill([], [], color=colour, label=name)


def _draw_section(axes: Axes, mesh: Mesh, axis: int, at: np.ndarray, colour: str, wide: float, name: str) -> None:
    from matplotlib.collections import LineCollection

    keep = [k for k in range(3) if k != axis]
    lines = 1e3 * section(mesh, axis, float(at[axis]))[:, :, keep]
    axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=wide, label=name, zorder=2))


def section(mesh: Mesh, axis: int, at: float) -> np.ndarray:
    """Segments [m] (n,2,3) in which the triangles meet the plane where a coordinate has this value [m]."""
    side = mesh.vertices[:, axis] - at
    side = np.where(side == 0.0, 1e-12, side)[mesh.triangles]
    met = np.flatnonzero((side > 0.0).any(axis=1) & (side < 0.0).any(axis=1))
    corners, side = mesh.vertices[mesh.triangles[met]], side[met]
    alone = np.argmax(np.sign(side) == -np.sign(np.sign(side).sum(axis=1))[:, None], axis=1)
    row = np.arange(len(met))
    ends = []
    for turn in (1, 2):
        other = (alone + turn) % 3
        share = side[row, alone] / (side[row, alone] - side[row, other])
        ends.append(corners[row, alone] + share[:, None] * (corners[row, other] - corners[row, alone]))
    return np.stack(ends, axis=1)


def _text(shown: Shown, width: float) -> str:
    import textwrap

    found, thin = rows(shown), shown.thickness[0]
    place = ", ".join(f"{1e3 * x:.3g}" for x in shown.thickness[1])
    lines = [
        f"volume {1e6 * found['volume m3']:.4g} cm³"
        + (f" ({1e6 * found['volume of the voxels m3']:.4g} cm³ of voxels)" if shown.image else ""),
        f"area {1e4 * found['area m2']:.4g} cm², {' x '.join(f'{1e3 * side:.3g}' for side in found['sides m'])} mm",
        f"{found['vertices']} vertices",
        f"smallest thickness {1e3 * thin:.2g} mm at ({place}) mm, except for {LEAST:.1%} of the vertices"
        if np.isfinite(thin) else f"thicker than {1e3 * DEEPEST:.3g} mm everywhere",
    ]  # fmt: skip
    if shown.felt is not None:
        at = ", ".join(f"{1e3 * x:.3g}" for x in shown.felt.place)
        lines.append(
            f"a finger of {1e3 * width:.3g} mm does not fit below {1e4 * shown.felt.area:.2g} cm² of bridges, up to "
            f"{1e3 * shown.felt.depth:.2g} mm deep, the deepest at ({at}) mm"
        )
    else:
        lines.append(f"a finger of {1e3 * width:.3g} mm fits everywhere")
    if shown.nodule is not None:
        at = ", ".join(f"{1e3 * x:.3g}" for x in shown.nodule.centre)
        lines.append(f"nodule: label {shown.nodule.name}, radius {1e3 * shown.nodule.radius:.3g} mm, at ({at}) mm")
        lines += list(shown.nodule.notes)
    if shown.bone is not None:
        lines.append(f"rigid: {shown.bone.name}, {1e3 * shown.bone.distance:.2g} mm from the organ")
    lines += [note.removeprefix(f"{shown.name}: ") for note in shown.notes[1:]]
    return "\n".join(textwrap.fill(line, 62, subsequent_indent="   ") for line in lines)
