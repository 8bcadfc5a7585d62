"""The bodies that are touched, as one surface: that of all of them together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import msgspec
import numpy as np

from palpate.messages import Load, Surface
from palpate.nodes.base.surface import complete
from palpate.physics.geometry.mesh import Mesh


@dataclass(frozen=True)
class Bodies:
    """Bodies with a mesh, in the order of the graph.

    streams  of the surface of each
    meshes   of each, undeformed
    loads    streams of loads, and the place of the body that each presses
    others   streams of bodies without a mesh
    """

    streams: Sequence[str]
    meshes: Sequence[Mesh]
    loads: Mapping[str, int]
    others: Sequence[str] = ()

    @classmethod
    def of(cls, meshes: Mapping[str, Mesh], streams: Sequence[str], loads: Mapping[str, str]) -> Bodies:
        """Those of all these streams that have a mesh; `loads`: of each, the stream of the body that it presses."""
        shown = list(meshes)
        pressed = {load: shown.index(body) for load, body in loads.items() if body in meshes}
        return cls(shown, list(meshes.values()), pressed, [stream for stream in streams if stream not in meshes])

    @property
    def left_out(self) -> str:
        """What no picture shows, a line for people; "" where all is shown."""
        return f"not shown: {', '.join(map(repr, self.others))}, without a mesh" if self.others else ""

    @cached_property
    def mesh(self) -> Mesh:
        """All meshes as one."""
        if len(self.meshes) == 1:
            return self.meshes[0]
        triangles = [m.triangles + first for m, first in zip(self.meshes, self._first, strict=True)]
        return Mesh(np.concatenate([m.vertices for m in self.meshes]), np.concatenate(triangles))

    @cached_property
    def _first(self) -> list[int]:
        """Place of the first vertex of each in the mesh of all."""
        return [0, *np.cumsum([len(m.vertices) for m in self.meshes])[:-1].tolist()]

    def surface(self, newest: Mapping[str, Surface]) -> Surface | None:
        """The surfaces of these streams as one on the mesh of all, with pressure and slip where all bodies send them;
        a body that has sent none is at rest. None where none has. What is not of the shape is that of the first."""
        shapes = [
            (first, complete(newest[stream], mesh.vertices))
            for stream, mesh, first in zip(self.streams, self.meshes, self._first, strict=True)
            if stream in newest
        ]
        if len(shapes) < 2:
            return next((msgspec.structs.replace(s, nodes=s.nodes + first) for first, s in shapes), None)
        every = [surface for _, surface in shapes]
        told = [name for name in ("pressure", "slipped") if all(len(getattr(s, name)) == len(s.nodes) for s in every)]
        more = {name: np.concatenate([getattr(s, name) for s in every]) for name in told}
        more |= {name: getattr(every[0], name)[:0] for name in ("pressure", "slipped") if name not in more}
        return msgspec.structs.replace(
            every[0], nodes=np.concatenate([s.nodes + first for first, s in shapes]),
            displacement=np.concatenate([s.displacement for s in every]), **more,
        )  # fmt: skip

    def pressed(self, newest: Mapping[str, Load]) -> dict[str, list]:
        """Vertices of the mesh of all that these loads press, `patch`, and the size of each force [N], `loads`."""
        patch: list[int] = []
        sizes: list[float] = []
        for stream, load in newest.items():
            patch += (load.nodes + self._first[self.loads[stream]]).tolist()
            sizes += np.round(np.linalg.norm(load.forces, axis=1), 6).tolist()
        return {"patch": patch, "loads": sizes} if newest else {}
