"""The deformable body as a bed of viscoelastic beams under its surface."""

from __future__ import annotations

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector, Vector3
from palpate.nodes.base import SettingError, Switch, part
from palpate.nodes.base.nodule import WithNodule
from palpate.physics.bodies.beam_bed import LARGEST_FORCE, BeamFoundation
from palpate.physics.entry_point import NO_FLOATS, NO_NODES
from palpate.physics.materials.viscoelastic import SKIN, TISSUE, ViscoelasticMaterial


class BeamBundle(WithNodule):
    """Beams of viscoelastic layers below each vertex of a surface (docs/equations/beam-bundle.md).

    Layers are listed from the surface inwards. The terminal law is that of the next implicit step. The pressure told
    is the load of each node over its area. A nodule makes the beams above it stiffer.
    """

    effect = "deformation"
    rank = 2

    layers: Annotated[Vector, "m"] = (1e-3, 9e-3)
    """Thickness of each layer."""
    moduli: Annotated[Vector, "Pa"] = (SKIN.modulus, TISSUE.modulus)
    relaxations: Annotated[Vector, "s", Switch("relaxation")] = (SKIN.relaxation, TISSUE.relaxation)
    """Viscosity over modulus of each layer."""
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, le=0.5)] = TISSUE.poisson
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 6e-3
    """Of the patch whose response is told before a force acts."""

    def start(self) -> None:
        """The beams at rest."""
        if not len(self.layers) == len(self.moduli) == len(self.relaxations) > 0:
            raise SettingError(
                f"layers, moduli, relaxations: found {len(self.layers)}, {len(self.moduli)}, {len(self.relaxations)} "
                f"numbers, expected one of each for every layer"
            )
        if min(self.layers) <= 0 or min(self.moduli) <= 0 or min(self.relaxations) < 0:
            raise SettingError(
                f"layers {self.layers} m, moduli {self.moduli} Pa, relaxations {self.relaxations} s: "
                f"expected thicknesses and moduli > 0, relaxations >= 0"
            )
        mesh = self.mesh()
        faces = mesh.face_vectors
        closed = np.abs(faces.sum(axis=0)).max() < 1e-6 * np.abs(faces).sum()
        thickness = float(np.ptp(mesh.vertices, axis=0).min())
        if closed and sum(self.layers) > thickness:
            raise SettingError(
                f"layers: found {sum(self.layers) * 1e3:g} mm in all, the body is {thickness * 1e3:.1f} mm thick: its "
                f"beams would end beyond the other side"
            )
        materials = tuple(
            ViscoelasticMaterial(modulus, relaxation, self.poisson)
            for modulus, relaxation in zip(self.moduli, self.relaxations, strict=True)
        )
        self.bed = BeamFoundation(mesh, self.hardness(), self.layers, materials, self.radius)
        self.facing = mesh.normals
        self.areas = mesh.areas
        self.push = np.zeros(len(mesh.areas))
        self._place: tuple[Vector3, Vector3] | None = None

    def rests(self, load: Load) -> bool:
        return not (len(load.nodes) or self.bed.count) and self._place == (load.foot, load.normal)

    def step(self, load: Load, *, dt: float) -> Surface:
        """Step the beams under the load; the indentation told is conjugate to the force."""
        bed = self.bed
        try:
            stiffness, exponent, free, previous, limited, _ = bed.step(
                load.nodes, load.forces, load.foot, load.normal, dt
            )
        except IndexError as error:
            raise SettingError(
                f"Load.nodes: {error} ({self.surface!r}); give the node that spreads the load the same surface"
            ) from None
        self._place = (load.foot, load.normal)
        nodes = self._displaced()
        return Surface(
            nodes=nodes,
            displacement=bed.moved[: len(nodes)],
            pressure=self._pressure(load, nodes),
            stiffness=stiffness,
            exponent=exponent,
            damping=0.0,
            rest_indentation=free,
            previous_indentation=previous,
            step=dt,
            relaxation=bed.relaxation(dt),
            limited=int(limited),
        )

    @part("shape", "nodes", "displacement", otherwise=NO_NODES, also=("pressure",))
    def _displaced(self) -> np.ndarray:
        """The vertices of the surface that are displaced."""
        return self.bed.nodes[: self.bed.count]

    @part("pressure", "pressure", otherwise=NO_FLOATS)
    def _pressure(self, load: Load, nodes: np.ndarray) -> np.ndarray:
        """Of the displaced nodes; 0 for those that still recover."""
        held = np.clip(load.forces, -LARGEST_FORCE, LARGEST_FORCE)  # as the beams take it
        inward = -np.einsum("ka,ka->k", held, self.facing[load.nodes])
        np.add.at(self.push, load.nodes, inward)
        pressure = np.maximum(self.push[nodes], 0.0) / self.areas[nodes]
        self.push[load.nodes] = 0.0
        return pressure
