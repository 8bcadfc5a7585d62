"""Where the finger is relative to the undeformed surface: foot point, normal, gap, approach, slip.

Let p be the bone edge of the fingertip, S the nearest point of the surface and n its outward normal. The gap is the
signed distance d = (p - S).n. For a fingertip with tissue of thickness h0 in front of the bone, the approach is
e = <h0 - d>: contact begins at d = h0. Once p is inside, S is a proxy: it stays on the side where p entered. Where the
nearest point leaps, S follows it no faster than p moves (`physics.geometry.proxy`); both cases are reported.
"""

from collections.abc import Mapping
from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.records import array_of, floats, integers, lend, longs, put, vector
from palpate.messages import Pose, Proximity
from palpate.messages.record import array_handle
from palpate.nodes.base import ARRAY, TABLE, Agrees, CompiledNode, Out, SettingError
from palpate.nodes.base.felt import WithWidth, bridge_notes, felt_part, felt_surface, is_bridged, shared_notes
from palpate.nodes.base.felt.organs import Part, shared_part
from palpate.nodes.base.kernels import kernel
from palpate.nodes.base.surface import OPEN, SURFACES, OnSurface, Placed, place_mesh, refinement, surface_patch
from palpate.physics.geometry import closest, mesh_closest
from palpate.physics.geometry import mesh as meshes
from palpate.physics.geometry.bvh import CELLS, DISCS, POINTS
from palpate.physics.geometry.nurbs import LAYOUT
from palpate.physics.geometry.proxy import MEMORY, OUT, follow, follow_mesh, memory
from palpate.physics.geometry.search.foot import FOOT
from palpate.physics.geometry.search.samples import CLUSTER, SAMPLE, SPACING
from palpate.physics.geometry.topology import edge_counts

_points_of, _cells_of, _discs_of, _work_of = map(array_of, (POINTS, CELLS, DISCS, mesh_closest.WAITING))
_samples_of, _clusters_of = array_of(element_type(SAMPLE)), array_of(element_type(CLUSTER))

TRAILS = 0.5e-3  # [m] distance of the foot from the nearest point above which it is reported
CAUSES = 2  # the foot trails the nearest point; the nearest point is on another side
REACH = 1.0
"""[1] of the finger's width: distance of the foot from an organ above which the finger moves away from it. The patch
reaches half as far, so that the tissue below it follows the finger before it bears a part of the force."""
SHARED = ("shares", "distances", "share")
CAUTIONS = {"outside": bool, "first": (CAUSES,), "seen": int}
"""Whether the foot of this step is not the nearest point; time [ns] of the first case
of each cause; number of causes as a bit mask."""


class _Nearest(Placed, WithWidth, CompiledNode):
    """Settings and reports of both nodes."""

    thickness: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.05), Agrees(Pose, Proximity)] = 4e-3
    """Fingertip tissue in front of the bone edge, h0."""
    hysteresis: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.01)] = 1e-4
    """The foot point changes to another part of the surface when that part is nearer by this distance."""
    conditions = {"outside": "outside its range"}

    def notes(self) -> list[str]:
        """A note for each cause for which the foot was not the nearest point."""
        seen = int(self.known["seen"])
        name, (trails, passed) = type(self).__name__, 1e-9 * self.known["first"]
        if seen & 1:
            self._note_once(
                f"{name}: from {trails:.3f} s on the nearest point of the surface leapt ahead of the finger, as near a "
                "centre of curvature, in a groove, at a rim and over the edges of large triangles. The foot point "
                "follows it no faster than the finger moves: force and direction there are bounded, but approximate"
            )
        if seen & 2:
            self._note_once(
                f"{name}: at {passed:.3f} s the finger was deeper than the middle of a thin part. The force continues "
                "on the side where it entered: it is bounded, but meaningless beyond the thickness"
            )
        return super().notes()


@kernel
def send(own, foot, pose, out):
    """Fill the message from a `FOOT`."""
    n0, n1, n2 = vector(foot.normal)
    depth = own.thickness - foot.distance
    out.delayed = pose.delayed
    v = pose.velocity
    away = v[0] * n0 + v[1] * n1 + v[2] * n2
    put(out.foot, vector(foot.point))
    put(out.normal, (n0, n1, n2))
    put(out.slip, (v[0] - away * n0, v[1] - away * n1, v[2] - away * n2))
    out.coordinates[0], out.coordinates[1] = foot.place[0], foot.place[1]
    out.element, out.gap = foot.triangle, foot.distance
    out.approach, out.separation = (0.0, -depth) if depth < 0.0 else (depth, 0.0)
    # report a foot that is not the nearest point; a bone edge that leaves the surface has passed nothing
    trails, passed = own.memory.behind > TRAILS and depth > 0.0, own.memory.passed and own.memory.side != OUT
    own.outside = trails or passed
    if own.outside:
        for cause, found in enumerate((trails, passed)):
            if found and not own.seen & (1 << cause):
                own.seen |= 1 << cause
                own.first[cause] = pose.time


@kernel
def between(values, v, w):
    """A value inside a triangle, from those at its corners (3) and the weights of the second and third."""
    return (1.0 - v - w) * values[0] + v * values[1] + w * values[2]


def _hollow(surface: str, width: float) -> str:
    return f"a finger {1e3 * width:.3g} mm wide cannot enter all hollows of {surface}"


class Nurbs(_Nearest):
    """The closest point of a smooth patch (docs/equations/surface.md)."""

    State = CAUTIONS | {
        "patch": ARRAY, "layout": LAYOUT, "spans": ARRAY,
        "samples": ARRAY, "clusters": ARRAY, "links": ARRAY, "spacing": SPACING,
        "tracked": closest.TRACKED, "work": ARRAY, "derivatives": array_handle(3), "foot": FOOT, "memory": MEMORY,
    }  # fmt: skip
    """The last 12: arguments of `physics.geometry.proxy.follow`."""
    shared = ("patch", "spans", "samples", "clusters", "links")

    @classmethod
    def instead(cls, values: Mapping[str, Any]) -> tuple[str, str] | None:
        surface, width = values["surface"], values["width"]
        if values["organs"] and width > 0.0 and shared_part(values["organs"], width)[0] is not None:
            return "collision.Mesh", f"a finger {1e3 * width:.3g} mm wide cannot enter the gap to another organ"
        bridged = surface in SURFACES and is_bridged(surface, width)
        return ("collision.Mesh", _hollow(surface, width)) if bridged else None

    def start(self) -> None:
        super().start()
        patch = surface_patch(self.surface, self.position, self.rotation)
        search = closest.ClosestPoint(patch)
        held = *search.tables, *search.scratch(), memory(self.surface in OPEN, self.thickness)
        for name, each in zip([n for n in self.State if n not in CAUTIONS], held, strict=True):
            self.hold(name, each)
        if is_bridged(self.surface, self.width):  # a lane of an ensemble, or a node by itself
            self._notes.append(
                f"{_hollow(self.surface, self.width)}. collision.Mesh bridges them; this node does not, and the force "
                "there is too small"
            )

    @kernel
    def compute(own, pose: Pose, out: Out[Proximity], dt):
        follow(
            floats(own.patch), own.layout, longs(own.spans), _samples_of(own.samples), _clusters_of(own.clusters),
            longs(own.links), own.spacing, vector(pose.position), own.hysteresis,
            own.tracked, floats(own.work), floats(own.derivatives), own.foot, own.memory, dt,
        )  # fmt: skip
        send(own, own.foot, pose, out)


class Mesh(_Nearest, OnSurface):
    """The closest point of a triangle mesh, with bridges over what the finger is too wide to enter
    (docs/equations/surface.md)."""

    State = CAUTIONS | {
        "points": ARRAY, "cells": ARRAY, "discs": ARRAY, "star_at": ARRAY, "star": ARRAY,  # of the mesh
        "tracked": mesh_closest.TRACKED, "work": ARRAY, "foot": FOOT, "memory": MEMORY,
        "shares": TABLE, "distances": TABLE, "share": ARRAY,  # of several organs
    }  # fmt: skip
    """From `points` to `memory`: arguments of `physics.geometry.proxy.follow_mesh`. At the corners of each triangle the
    part of the patch on this organ [1] (T,3) and the distance from it [m] (T,3), if several are felt together; the part
    that is sent."""
    shared = ("points", "cells", "discs", "star_at", "star", "shares", "distances")

    def start(self) -> None:
        super().start()
        mesh = whole = self.mesh()
        part, fault = felt_part(self)
        bridged = felt_surface(self, self.width)
        if part is not None:
            mesh = part.mesh
        elif bridged.felt is not None:
            mesh = place_mesh(bridged.felt.mesh, self.position, self.rotation)
        search = mesh_closest.MeshClosestPoint(mesh)
        try:
            tables = search.tables
        except ValueError as error:
            raise SettingError(f"setting 'surface': {self.surface}: {error}") from None
        origin: np.ndarray = tables.cells["origin"]  # a view
        self._share(part, mesh, origin)
        if part is not None:
            origin[:] = part.origin[origin]
        elif bridged.felt is not None:
            origin[:] = bridged.felt.origin[origin]
        border = edge_counts(mesh.triangles, len(mesh.vertices))[0] > 0
        held = *tables.arrays, *search.scratch(), memory(border, self.thickness)
        for name, each in zip([n for n in self.State if n not in (*CAUTIONS, *SHARED)], held, strict=True):
            self.hold(name, each)
        if self.surface not in SURFACES:
            from palpate.nodes.base.mesh_file import flaws  # needs an optional package

            self._notes = [*flaws(self.surface, self.piece), *self._refinement(whole)]
        self._notes += bridge_notes(self.surface, self.width, bridged) if part is None else []
        self._notes += shared_notes(self.surface, self.width, part, fault)

    def _share(self, part: Part | None, mesh: meshes.Mesh, order: np.ndarray) -> None:
        """Hold the tables of an organ's part; `order` of the triangles in the tree."""
        for name in ("shares", "distances"):
            found = np.zeros((0, 3))
            if part is not None:
                values = part.share if name == "shares" else part.away
                found = np.ascontiguousarray(values[mesh.triangles[order]])
            self.hold(name, found)
        self.hold("share", np.zeros(1 if part is not None else 0))

    def _refinement(self, mesh: meshes.Mesh) -> list[str]:
        """A note on the change by `refine`, if any."""
        moved, before = refinement(self.surface, self.file_unit, self.piece, self.refine)
        away = 1e3 * round(moved, 9)
        if len(mesh.vertices) != before:
            return [
                f"{self.surface}: triangles coarser than {1e3 * self.refine:.3g} mm are divided on a smooth surface: "
                f"{before} vertices become {len(mesh.vertices)}, up to {away:.2g} mm from the triangles of the "
                "file. This costs memory, start-up time and some time per tick. scene.surface.refine=0 keeps the "
                "triangles."
            ]
        if moved > 0.0:
            return [
                f"{self.surface}: the vertices scatter, as after marching cubes. They are moved onto a smooth surface, "
                f"up to {away:.2g} mm from the triangles of the file. scene.surface.refine=0 keeps them."
            ]
        return []

    @kernel
    def compute(own, pose: Pose, out: Out[Proximity], dt):
        follow_mesh(
            _points_of(own.points), _cells_of(own.cells), _discs_of(own.discs), longs(own.star_at), integers(own.star),
            vector(pose.position), own.hysteresis, own.tracked, _work_of(own.work), own.foot, own.memory, dt,
        )  # fmt: skip
        if own.share.shape[0] > 0:
            t, v, w = own.memory.shown, own.foot.place[0], own.foot.place[1]
            away = between(floats(own.distances)[t], v, w)
            floats(own.share)[0] = min(max(between(floats(own.shares)[t], v, w), 0.0), 1.0)
            own.foot.distance += max(away - REACH * own.width, 0.0)
        send(own, own.foot, pose, out)
        if own.share.shape[0] > 0:
            lend(out.share, own.share)
