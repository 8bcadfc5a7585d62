"""The deformable body as a bed of viscoelastic beams under its surface."""

from typing import Annotated

import msgspec
import numpy as np

from palpate.messages import Load, Surface, Vector, Vector3
from palpate.nodes.base import Calibrated, SettingError, Switch, part
from palpate.nodes.base.contacts import several
from palpate.nodes.base.nodule import WithNodule
from palpate.physics.bodies.beam_bed import BeamFoundation
from palpate.physics.bodies.beam_bed_step import LARGEST_FORCE
from palpate.physics.contact.terminal import Terminal
from palpate.physics.entry_point import NO_FLOATS, NO_NODES
from palpate.physics.materials.viscoelastic import SKIN, TISSUE, ViscoelasticMaterial

OF_TISSUE = Calibrated("a human fingertip", "palpate fit body")


class BeamBundle(WithNodule):
    """Beams of viscoelastic layers below each vertex of a surface (docs/equations/beam-bundle.md).

    Layers are listed from the surface inwards. The terminal law is that of the next implicit step. The pressure told
    is the load of each node over its area. A nodule makes the beams above it stiffer. Several
    contacts feel each other where their patches share beams.
    """

    effect = "deformation"
    rank = 2

    layers: Annotated[Vector, "m", OF_TISSUE] = (1e-3, 9e-3)  # Thickness of each layer
    moduli: Annotated[Vector, "Pa", OF_TISSUE] = (SKIN.modulus, TISSUE.modulus)
    relaxations: Annotated[Vector, "s", Switch("relaxation"), OF_TISSUE] = (SKIN.relaxation, TISSUE.relaxation)
    """Viscosity over modulus of each layer."""
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, le=0.5)] = TISSUE.poisson
    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 6e-3  # Of the patch whose response is told before a force acts

    def start(self) -> None:
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
        self.bed = self.foundation()
        self.facing = mesh.normals
        self.areas = mesh.areas
        self.push = np.zeros(len(mesh.areas))
        self._places: list[tuple[Vector3, Vector3]] = []

    def foundation(self, thicker: float = 1.0, slower: float = 1.0) -> BeamFoundation:
        """The beams at rest; with layers and moduli times a factor, which keeps their compliance, and with relaxation
        times times another."""
        layers = tuple(thicker * layer for layer in self.layers)
        materials = tuple(
            ViscoelasticMaterial(thicker * modulus, slower * relaxation, self.poisson)
            for modulus, relaxation in zip(self.moduli, self.relaxations, strict=True)
        )
        return BeamFoundation(self.mesh(), self.hardness(), layers, materials, self.radius)

    def rests(self, load: list[Load]) -> bool:
        still = not (self.bed.count or any(len(each.nodes) for each in load))
        return still and self._places == [(each.foot, each.normal) for each in load]

    def step(self, load: list[Load], *, dt: float) -> Surface:
        """Step the beams under the loads; the indentation told is conjugate to the force."""
        bed = self.bed
        try:
            found = bed.step([(each.nodes, each.forces, each.foot, each.normal) for each in load], dt)
        except IndexError as error:
            raise SettingError(
                f"Load.nodes: {error} ({self.surface!r}); give the node that spreads the load the same surface"
            ) from None
        laws = [Terminal(stiffness, exponent, 0.0, free, now) for stiffness, exponent, free, now in found]
        first = laws[0]
        self._places = [(each.foot, each.normal) for each in load]
        nodes = self._displaced()
        return Surface(
            nodes=nodes,
            displacement=bed.moved[: len(nodes)],
            pressure=self._pressure(load, nodes),
            stiffness=first.stiffness,
            exponent=first.exponent,
            damping=0.0,
            rest_indentation=first.rest_indentation,
            previous_indentation=first.previous_indentation,
            step=dt,
            relaxation=bed.relaxation(dt),
            limited=bed.limited,
            **several(laws, bed.coupling),
        )

    @part("shape", "nodes", "displacement", otherwise=NO_NODES, also=("pressure",))
    def _displaced(self) -> np.ndarray:
        """The vertices of the surface that are displaced."""
        return self.bed.nodes[: self.bed.count]

    @part("pressure", "pressure", otherwise=NO_FLOATS)
    def _pressure(self, load: list[Load], nodes: np.ndarray) -> np.ndarray:
        """Of the displaced nodes; 0 for those that still recover."""
        for each in load:
            held = np.clip(each.forces, -LARGEST_FORCE, LARGEST_FORCE)  # as the beams take it
            np.add.at(self.push, each.nodes, -np.einsum("ka,ka->k", held, self.facing[each.nodes]))
        pressure = np.maximum(self.push[nodes], 0.0) / self.areas[nodes]
        for each in load:
            self.push[each.nodes] = 0.0
        return pressure
