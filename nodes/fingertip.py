"""A fingertip of beams on a rigid plate: the scripted hand that moves it, and its contact."""

import math
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.angles import cos, sin
from palpate.compiler.entry_point import NO_FLOATS, NO_NODES, NO_VECTORS
from palpate.messages import Contact, Friction, Pose, Slip, Surface, Vector3
from palpate.nodes.base import Agrees, Node, SettingError, Switch, part
from palpate.nodes.base.samples import since
from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.fingertip.beam_bundle import FARTHEST, SHORTEST_STEP, Bundle, BundleState, step
from palpate.physics.fingertip.surfaces import FingertipSurfaces, fill
from palpate.physics.materials.voigt import BONE, SKIN, TISSUE, ViscoelasticMaterial

UP = (0.0, 0.0, 1.0)
CLEAR = 1e-3  # [m] height above the plate at which a lifted finger stops
NO_SLIP = {
    "fraction": 0.0, "front": 0.0, "incipient": False, "gross": False, "first": NO_FLOATS, "path": NO_FLOATS,
    "state": NO_NODES, "points": np.zeros((0, 2)),
}  # fmt: skip


class Slide(Node):
    """A hand that presses a fingertip on a plate, holds, slides and lifts it at constant speeds."""

    paced = True

    thickness: Annotated[float, "m", msgspec.Meta(ge=0), Agrees(Pose)] = 5e-3
    """Of the tissue in front of the bone edge; contact starts at this distance of the bone edge from the plate."""
    plate: Annotated[float, "m", Agrees(Pose)] = 0.0  # Height of the plate
    depth: Annotated[float, "m", msgspec.Meta(ge=0)] = 2e-3
    press: Annotated[float, "m/s", msgspec.Meta(gt=0)] = 4e-3
    hold: Annotated[float, "s", msgspec.Meta(ge=0)] = 1.0
    speed: Annotated[float, "m/s", msgspec.Meta(ge=0)] = 2e-3
    direction: Annotated[float, "rad"] = math.pi / 2
    """Angle in the plate's plane from x (across the finger); pi/2 pulls the finger back, -pi/2 pushes it forward."""
    distance: Annotated[float, "m", msgspec.Meta(ge=0)] = 5e-3  # Of the slide; 0: the hand only presses and holds
    lift: Annotated[float, "m/s", msgspec.Meta(ge=0)] = 0.0
    """Speed of lifting after the slide; 0: the finger stays."""

    def start(self) -> None:
        self.time = 0.0
        self.place: Vector3 = (0.0, 0.0, self.thickness + self.plate)

    def step(self, *, dt: float) -> Pose:
        self.time += dt
        sliding = max(self.time - self.depth / self.press - self.hold, 0.0)
        way = min(self.speed * sliding, self.distance)
        depth = min(self.press * self.time, self.depth)
        if self.lift > 0 and way >= self.distance:
            since = sliding - (self.distance / self.speed if self.distance > 0 else 0.0)
            depth = max(depth - self.lift * since, -CLEAR)
        place = (way * cos(self.direction), way * sin(self.direction), self.thickness + self.plate - depth)
        x, y, z = self.place
        velocity = ((place[0] - x) / dt, (place[1] - y) / dt, (place[2] - z) / dt)
        self.place = place
        return Pose(position=place, velocity=velocity, dt=dt)


class BundleContact(Node):
    """A fingertip as a beam bundle on a rigid plate: normal force, friction, stick and slip of every node.

    The bundle is filled at the start, from a scan that `palpate build fingertip` has read, or from the default
    anatomy, and meshed once for `reach`. Beyond this depth only these beams respond, so the force is bounded but too
    small, and `Slip.deeper` is set. See docs/equations/beam-bundle.md.
    """

    shape: Annotated[str, "1"] = "anatomy"  # "anatomy", or the path of a fingertip file (.npz)
    angle: Annotated[float, "rad", msgspec.Meta(ge=0, le=math.pi / 2)] = math.radians(20)
    """Inclination of the finger to the plate."""
    pitch: Annotated[float, "m", msgspec.Meta(gt=0)] = 1.2e-3
    reach: Annotated[float, "m", msgspec.Meta(gt=0)] = 2.5e-3  # Largest depth: the pad is meshed for it
    thickness: Annotated[float, "m", msgspec.Meta(ge=0), Agrees(Pose)] = 5e-3
    """Of the tissue in front of the bone edge, whose position is the pose."""
    plate: Annotated[float, "m", Agrees(Pose)] = 0.0  # Height of the plate, which is z = constant, the finger above it
    friction: Annotated[float, "1", msgspec.Meta(ge=0), Switch("friction")] = 0.7
    lateral: Annotated[Literal["shear", "cantilever"], "1"] = "shear"
    tissue_modulus: Annotated[float, "Pa", msgspec.Meta(gt=0)] = TISSUE.modulus
    tissue_relaxation: Annotated[float, "s", msgspec.Meta(ge=0), Switch("relaxation")] = TISSUE.relaxation
    skin_modulus: Annotated[float, "Pa", msgspec.Meta(gt=0)] = SKIN.modulus
    skin_relaxation: Annotated[float, "s", msgspec.Meta(ge=0), Switch("relaxation")] = SKIN.relaxation
    bone_modulus: Annotated[float, "Pa", msgspec.Meta(gt=0)] = BONE.modulus
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, lt=0.5)] = TISSUE.poisson
    sheet: Annotated[float, "m", msgspec.Meta(ge=0), Switch("sheet")] = 1e-3
    """Thickness of the skin that couples the beams' ends; 0: none."""
    warning: Annotated[float, "1", msgspec.Meta(gt=0, le=1)] = 0.1
    """Sliding fraction of the contact above which incipient slip is reported."""
    iterations: Annotated[int, "1", msgspec.Meta(ge=1, le=1000)] = 30  # Largest number of solver iterations in a step

    def start(self) -> None:
        """Fill the fingertip with beams, out of contact."""
        try:
            self.bundle = self._bundle()
        except ValueError as error:
            where = f"shape {self.shape!r}, angle {math.degrees(self.angle):.1f}°, reach {self.reach * 1e3:g} mm"
            raise SettingError(f"{where}: {error}") from None
        self.state = BundleState(self.bundle)
        self.before: Vector3 | None = None
        self.depth = 0.0
        self.onset = -1.0
        self.sampled = -1
        self.sent: tuple[Contact, Friction, Slip, Surface] | None = None

    def _bundle(self) -> Bundle:
        tissue = ViscoelasticMaterial(self.tissue_modulus, self.tissue_relaxation, self.poisson)
        skin = ViscoelasticMaterial(self.skin_modulus, self.skin_relaxation, self.poisson)
        bone = ViscoelasticMaterial(self.bone_modulus, 0.0, self.poisson)
        tip = Anatomy().fingertip() if self.shape == "anatomy" else FingertipSurfaces.load(self.shape)
        return fill(
            tip, self.reach, self.pitch, self.angle, (skin, tissue, bone, tissue), self.lateral, self.sheet, skin
        )

    def step(self, pose: Pose, *, dt: float) -> tuple[Contact, Friction, Slip, Surface]:
        sample = pose.time - (pose.delayed or 0) if pose.time >= 0 else -1
        dt = since.py_func(self, sample, dt)
        if dt == 0.0 and self.sent is not None:  # the same pose again
            return self.sent
        x, y, z = pose.position
        last = self.before or pose.position
        depth = min(max(self.thickness + self.plate - z, -FARTHEST), FARTHEST)
        shift = (x - last[0], y - last[1])
        rate = (max(depth, 0.0) - max(self.depth, 0.0)) / max(dt, SHORTEST_STEP)
        self.before, self.depth = pose.position, depth
        reaction = step(self.bundle, self.state, depth, shift, self.friction, dt, most=self.iterations)
        if self.state.summary.contacts == 0:
            self.onset = -1.0
        elif self.onset < 0 and shift != (0.0, 0.0):
            self.onset = self.state.time - dt
        contact = Contact(foot=(x, y, self.plate), normal=UP, force=float(reaction[2]),
                          compression=max(depth, 0.0), indentation=0.0,
                          compression_rate=rate, indentation_rate=0.0)  # fmt: skip
        self.sent = contact, self._friction(reaction), self._slip(), self._surface()
        return self.sent

    def _friction(self, reaction: np.ndarray) -> Friction:
        summary = self.state.summary
        touching = self.state.normal > 0
        bristle = -self.state.deflection[touching].mean(axis=0) if summary.contacts else np.zeros(2)
        sticks = summary.slips < summary.contacts
        return Friction(force=(-reaction[0], -reaction[1], 0.0), bristle=(*bristle, 0.0), stick=sticks)

    def _slip(self) -> Slip:
        summary = self.state.summary
        return Slip(
            contacts=summary.contacts, limited=summary.limited, deeper=self.depth > self.reach * (1 + 1e-9),
            iterations=summary.iterations, residual=summary.residual, **self._sliding_parts(),
        )  # fmt: skip

    @part("slip", "fraction", "front", "incipient", "gross", "first", "path", "state", "points", otherwise=NO_SLIP)
    def _sliding_parts(self) -> dict[str, Any]:
        """Sliding parts of the contact, with onset and path of each node."""
        s = self.state
        contacts, slips = s.summary.contacts, s.summary.slips
        fraction, gross = slips / contacts if contacts else 0.0, 0 < contacts == slips
        return {
            "fraction": fraction, "front": math.sqrt((contacts - slips) * self.bundle.cell / math.pi),
            "incipient": fraction >= self.warning and not gross, "gross": gross,
            "first": np.where(s.first < 0, -1.0, np.maximum(s.first - max(self.onset, 0.0), 0.0)), "path": s.path,
            "state": (s.normal > 0).astype("<i4") + s.slipping, "points": self.bundle.points,
        }  # fmt: skip

    def _surface(self) -> Surface:
        """The pad, and the law of the fingertip for its next step: depth against normal force."""
        s = self.state
        touching = np.flatnonzero(s.normal > 0)
        nodes, moved = self._shape(touching)
        # The law of the next step is a sum of linear laws with different onsets. Its tangent at this depth is exact
        # until new beams touch, and a lower bound beyond.
        stiffness, touch, force = s.summary.next_stiffness, s.summary.next_touch, s.summary.next_force
        free = max(self.depth - force / stiffness, touch) if force > 0 else touch
        return Surface(
            nodes=nodes, displacement=moved, stiffness=stiffness, exponent=1.0, damping=0.0,
            rest_indentation=free, previous_indentation=max(self.depth, 0.0),
            pressure=self._pressure(touching),
            slipped=self._sliding(touching), limited=s.summary.limited,
        )  # fmt: skip

    @part("shape", "nodes", "displacement", otherwise=(NO_NODES, NO_VECTORS), also=("pressure", "slipped"))
    def _shape(self, touching: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of the pad that touch, and their displacement."""
        s, moved = self.state, np.zeros((len(touching), 3))
        moved[:, :2] = s.deflection[touching]
        moved[:, 2] = np.minimum(self.depth - self.bundle.heights[touching], s.reach[touching])
        return touching, moved

    @part("pressure", "pressure", otherwise=NO_FLOATS)
    def _pressure(self, touching: np.ndarray) -> np.ndarray:
        """Pressure [Pa] of the plate on each node that touches."""
        return self.state.normal[touching] / self.bundle.cell

    @part("slip", "slipped", otherwise=NO_NODES)
    def _sliding(self, touching: np.ndarray) -> np.ndarray:
        """Which of the nodes that touch slide."""
        return self.state.slipping[touching]
