"""Joins the surfaces of all touched bodies into one."""

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

    streams  stream of each body's surface
    meshes   undeformed mesh of each body
    loads    streams of loads, with the index of the body that each presses
    others   streams of bodies without a mesh
    """

    streams: Sequence[str]
    meshes: Sequence[Mesh]
    loads: Mapping[str, int]
    others: Sequence[str] = ()

    @classmethod
    def of(cls, meshes: Mapping[str, Mesh], streams: Sequence[str], loads: Mapping[str, str]) -> Bodies:
        """The bodies of these streams that have a mesh; `loads`: the body's stream for each stream of loads."""
        shown = list(meshes)
        pressed = {load: shown.index(body) for load, body in loads.items() if body in meshes}
        return cls(shown, list(meshes.values()), pressed, [stream for stream in streams if stream not in meshes])

    @property
    def left_out(self) -> str:
        """A line on bodies that are not shown; "" if all are."""
        return f"not shown: {', '.join(map(repr, self.others))}, without a mesh" if self.others else ""

    @cached_property
    def mesh(self) -> Mesh:
        if len(self.meshes) == 1:
            return self.meshes[0]
        triangles = [m.triangles + first for m, first in zip(self.meshes, self._first, strict=True)]
        return Mesh(np.concatenate([m.vertices for m in self.meshes]), np.concatenate(triangles))

    @cached_property
    def _first(self) -> list[int]:
        """Index of each body's first vertex in the joint mesh."""
        return [0, *np.cumsum([len(m.vertices) for m in self.meshes])[:-1].tolist()]

    def surface(self, newest: Mapping[str, Surface]) -> Surface | None:
        """The surfaces of these streams as one Surface on the joint mesh, with pressure and slip if all bodies send
        them. Bodies without a message are at rest; None if no body has one. Other fields are those of the first."""
        shapes = [
            (first, complete(newest[stream], mesh.vertices))
            for stream, mesh, first in zip(self.streams, self.meshes, self._first, strict=True)
            if stream in newest
        ]
        if len(shapes) < 2:
            return next((msgspec.structs.replace(s, nodes=s.nodes + first) for first, s in shapes), None)
        every = [surface for _, surface in shapes]
        sent = [name for name in ("pressure", "slipped") if all(len(getattr(s, name)) == len(s.nodes) for s in every)]
        more = {name: np.concatenate([getattr(s, name) for s in every]) for name in sent}
        more |= {name: getattr(every[0], name)[:0] for name in ("pressure", "slipped") if name not in more}
        return msgspec.structs.replace(
            every[0], nodes=np.concatenate([s.nodes + first for first, s in shapes]),
            displacement=np.concatenate([s.displacement for s in every]), **more,
        )  # fmt: skip

    def pressed(self, newest: Mapping[str, Load]) -> dict[str, list]:
        """Vertices of the joint mesh that these loads press, `patch`, and the size of each force [N], `loads`."""
        patch: list[int] = []
        sizes: list[float] = []
        for stream, load in newest.items():
            patch += (load.nodes + self._first[self.loads[stream]]).tolist()
            sizes += np.round(np.linalg.norm(load.forces, axis=1), 6).tolist()
        return {"patch": patch, "loads": sizes} if newest else {}
