"""Where the finger is relative to the undeformed surface: foot point, normal, gap, approach, slip.

Let p be the bone edge of the fingertip, S the nearest point of the surface and n its outward normal. The gap is the
signed distance d = (p - S).n. For a fingertip with tissue of thickness h0 in front of the bone, the approach is
e = <h0 - d>: contact begins at d = h0. Once p is inside, S is a proxy: it stays on the side where p entered.
"""

from typing import Annotated

import msgspec

from palpate.compiler.kernel import kernel
from palpate.compiler.records import floats, integers, longs, put, vector
from palpate.messages import Pose, Proximity
from palpate.messages.record import array_handle
from palpate.nodes.base import ARRAY, TABLE, CompiledNode, Out, SettingError
from palpate.nodes.base.surface import OPEN, SURFACES, OnSurface, Placed, refinement, surface_patch
from palpate.physics.geometry import mesh as meshes
from palpate.physics.geometry.closest import ClosestPoint
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.proxy import follow, follow_mesh, memory
from palpate.physics.geometry.topology import edge_counts


class _Nearest(Placed, CompiledNode):
    """Settings of both nodes."""

    thickness: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.05)] = 4e-3
    """Fingertip tissue in front of the bone edge, h0."""
    hysteresis: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.01)] = 1e-4
    """The foot point jumps to another part of the surface when that part is nearer by this distance."""


@kernel
def send(own, foot, element, pose, out):
    """Fill the message from a result: foot (3) [m], normal (3) [1], coordinates (2), signed distance [m]."""
    n0, n1, n2, depth = foot[3], foot[4], foot[5], own.thickness - foot[8]
    out.delayed = pose.delayed
    v = pose.velocity
    away = v[0] * n0 + v[1] * n1 + v[2] * n2
    put(out.foot, vector(foot))
    put(out.normal, (n0, n1, n2))
    put(out.slip, (v[0] - away * n0, v[1] - away * n1, v[2] - away * n2))
    out.coordinates[0], out.coordinates[1], out.element, out.gap = foot[6], foot[7], element, foot[8]
    out.approach, out.separation = (0.0, -depth) if depth < 0.0 else (depth, 0.0)


class Nurbs(_Nearest):
    """The closest point of a smooth patch (docs/equations/surface.md)."""

    State = {
        "data": ARRAY, "layout": ARRAY, "seeds": ARRAY, "index": ARRAY,  # of the patch and its samples
        "found": ARRAY, "work": ARRAY, "derivatives": array_handle(3), "foot": ARRAY, "memory": ARRAY,
    }  # fmt: skip
    """Arguments of `physics.geometry.proxy.follow`."""
    shared = ("data", "layout", "seeds", "index")

    def start(self) -> None:
        super().start()
        patch = surface_patch(self.surface, self.position, self.rotation)
        closest = ClosestPoint(patch)
        arrays = *closest.tables, *closest.scratch(), memory(patch.points, self.surface in OPEN)
        for name, array in zip(self.State, arrays, strict=True):
            self.hold(name, array)

    @kernel
    def compute(own, pose: Pose, out: Out[Proximity], dt):
        foot = floats(own.foot)
        follow(
            floats(own.data), longs(own.layout), floats(own.seeds), longs(own.index), vector(pose.position),
            own.hysteresis, floats(own.found), floats(own.work), floats(own.derivatives), foot, floats(own.memory),
        )  # fmt: skip
        send(own, foot, 0, pose, out)


class Mesh(_Nearest, OnSurface):
    """The closest point of a triangle mesh (docs/equations/surface.md)."""

    State = {
        "points": TABLE, "cells": TABLE, "discs": TABLE, "star_at": ARRAY, "star": ARRAY,  # of the mesh
        "work": ARRAY, "foot": ARRAY, "memory": ARRAY,
    }  # fmt: skip
    """Arguments of `physics.geometry.proxy.follow_mesh`."""
    shared = ("points", "cells", "discs", "star_at", "star")

    def start(self) -> None:
        super().start()
        mesh = self.mesh()
        closest = MeshClosestPoint(mesh)
        try:
            tables = closest.tables.arrays
        except ValueError as error:
            raise SettingError(f"setting 'surface': {self.surface}: {error}") from None
        border = edge_counts(mesh.triangles, len(mesh.vertices))[0] > 0
        arrays = *tables, *closest.scratch(), memory(mesh.vertices, border)
        for name, array in zip(self.State, arrays, strict=True):
            self.hold(name, array)
        if self.surface not in SURFACES:
            from palpate.nodes.base.mesh_file import flaws  # needs an optional package

            self._notes = [*flaws(self.surface, self.piece), *self._refinement(mesh)]

    def _refinement(self, mesh: meshes.Mesh) -> list[str]:
        """A note on the change by `refine`, if any."""
        moved, before = refinement(*self._surface)
        if len(mesh.vertices) == before:
            return []
        return [
            f"{self.surface}: triangles coarser than {1e3 * self.refine:.3g} mm are divided on a smooth surface: "
            f"{before} vertices become {len(mesh.vertices)}, up to {1e3 * moved:.2g} mm from the triangles of the file."
            " This costs memory and start-up time, no time per tick. scene.surface.refine=0 keeps the triangles."
        ]

    @kernel
    def compute(own, pose: Pose, out: Out[Proximity], dt):
        foot = floats(own.foot)
        follow_mesh(
            floats(own.points), integers(own.cells), floats(own.discs), longs(own.star_at), integers(own.star),
            vector(pose.position), own.hysteresis, longs(own.work), foot, floats(own.memory),
        )  # fmt: skip
        send(own, foot, int(foot[9]), pose, out)
