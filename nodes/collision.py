"""Where the finger is relative to the undeformed surface: foot point, normal, gap, approach, slip.

With p the bone edge of the fingertip, S the nearest point of the surface and n its outward normal, the gap is the
signed distance d = (p - S).n, and the approach is e = <h0 - d> for a fingertip with tissue of thickness h0 before the
bone: contact begins at d = h0. Once p has gone in, S is a proxy: it stays on the side where it did.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
import numpy as np

from palpate.messages import Pose, Proximity
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import OPEN, PLACE, SURFACES, OnSurface, Placed, surface_patch
from palpate.physics.entry_point import entry_point
from palpate.physics.geometry.closest import ClosestPoint
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.orient import edge_counts
from palpate.physics.geometry.proxy import follow, follow_mesh, memory


class _Nearest(Placed):
    """Settings of both."""

    thickness: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.05)] = 4e-3
    """Fingertip tissue in front of the bone edge, h0."""
    hysteresis: Annotated[float, "m", msgspec.Meta(ge=0.0, le=0.01)] = 1e-4
    """Where two parts of the surface are equally near, the foot point stays until the other is nearer by this."""


class Nurbs(_Nearest):
    """The closest point of a smooth patch (docs/equations/surface.md)."""

    def start(self) -> None:
        patch = surface_patch(self.surface, self.position, self.rotation)
        closest = ClosestPoint(patch)
        self.tables = closest.tables
        self.scratch = closest.scratch()
        self.memory = memory(patch.points, self.surface in OPEN)
        self._follow = entry_point(follow, *self.tables, PLACE, 0.0, *self.scratch, self.memory)

    def step(self, pose: Pose) -> Proximity:
        self._follow(*self.tables, pose.position, self.hysteresis, *self.scratch, self.memory)
        return _proximity(self.scratch[3], 0, self.thickness, pose)


class Mesh(_Nearest, OnSurface):
    """The closest point of a triangle mesh (docs/equations/surface.md)."""

    def start(self) -> None:
        mesh = self.mesh()
        closest = MeshClosestPoint(mesh)
        try:
            self.tables = closest.tables.arrays
        except ValueError as error:
            raise SettingError(f"setting 'surface': {self.surface}: {error}") from None
        self.work, self.foot = closest.scratch()
        self.memory = memory(mesh.vertices, edge_counts(mesh.triangles, len(mesh.vertices))[0] > 0)
        self._follow = entry_point(follow_mesh, *self.tables, PLACE, 0.0, self.work, self.foot, self.memory)
        self._notes = []
        if self.surface not in SURFACES:
            from palpate.nodes.base.mesh_file import flaws  # its package is an extra

            self._notes = flaws(self.surface)

    def step(self, pose: Pose) -> Proximity:
        self._follow(*self.tables, pose.position, self.hysteresis, self.work, self.foot, self.memory)
        return _proximity(self.foot, int(self.foot[9]), self.thickness, pose)


def _proximity(foot: np.ndarray[Any, Any], element: int, thickness: float, pose: Pose) -> Proximity:
    """The message of a result: foot (3), normal (3), coordinates (2), signed distance."""
    f0, f1, f2, n0, n1, n2, u, v, gap = foot.tolist()[:9]
    depth = thickness - gap
    v0, v1, v2 = pose.velocity
    out = v0 * n0 + v1 * n1 + v2 * n2
    return Proximity(
        foot=(f0, f1, f2),
        normal=(n0, n1, n2),
        coordinates=(u, v),
        element=element,
        gap=gap,
        approach=0.0 if depth < 0.0 else depth,
        separation=-depth if depth < 0.0 else 0.0,
        slip=(v0 - out * n0, v1 - out * n1, v2 - out * n2),
    )
