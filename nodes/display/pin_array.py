"""Heights of a pin array that renders a contact to the fingerpad."""

from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.compiler.exact import einsum, length, product
from palpate.messages import Contact, Pins, Surface, Vector3
from palpate.nodes.base import Ideal, SettingError, Wants
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.physics.contact.subsurface import next_axis
from palpate.physics.display import shape_display as pads
from palpate.physics.display.pin_heights import heights_from_force, heights_from_pressure, heights_from_surface
from palpate.physics.display.pins import Drives, drive, pin_grid
from palpate.physics.nearest import nearest, tree_of

STEPS = Ideal("steps of a pin", hand=False)
NEIGHBOURS = 9  # number of surface vertices that determine the height of a pin: one and its neighbours on a square mesh


class PinArray(OnThinnedSurface):
    """Pins under the fingerpad on a linear actuator (docs/equations/shape-display.md).

    `shows` selects the source of the shape. "force": the normal force, by the model of a fingerpad on homogeneous
    tissue. "surface": the deformed surface of the tissue. "pressure": the contact pressure of the tissue model. The
    last two render structures below the surface; only they use the settings of the surface and the input `surface`.
    While it is missing, or for "pressure" contains no pressure, the source is the force, and `valid` is false.

    The pins are in the tangent plane at the contact: rows along the world's x axis at the first contact (y axis if the
    normal is within 26 degrees of x), columns along normal × row. They turn with the normal by the smallest rotation,
    as the receptors of tactile.Stress do. `pad` names the fingerpad; `pad_b`, `pad_m` and `pad_radius` replace
    single parameters of it.
    """

    effect = "display"

    shows: Annotated[Literal["force", "surface", "pressure"], "1"] = "force"

    rows: Annotated[int, "1", msgspec.Meta(ge=1, le=1000)] = 6
    columns: Annotated[int, "1", msgspec.Meta(ge=1, le=1000)] = 6
    pitch: Annotated[float, "m", msgspec.Meta(gt=0, le=0.1)] = 2.0e-3
    stroke: Annotated[float, "m", msgspec.Meta(gt=0, le=0.1)] = 4.0e-3
    travel: Annotated[float, "m", msgspec.Meta(gt=0, le=1)] = 0.05
    rate: Annotated[float, "m/s", msgspec.Meta(gt=0, le=1e3)] = 0.1
    actuator_rate: Annotated[float, "m/s", msgspec.Meta(gt=0, le=1e3)] = 0.5
    rise_time: Annotated[float, "s", msgspec.Meta(ge=0, le=1e3)] = 0.0
    fall_time: Annotated[float, "s", msgspec.Meta(ge=0, le=1e3)] = 0.0
    resolution: Annotated[float, "m", msgspec.Meta(ge=0, le=0.1), STEPS] = 0.0

    pad: Annotated[Literal["canonical", "calibrated"], "1"] = "canonical"
    pad_b: Annotated[Annotated[float, msgspec.Meta(gt=0, le=1e12)] | None, "Pa/m"] = None
    pad_m: Annotated[Annotated[float, msgspec.Meta(gt=0, le=1e5)] | None, "1/m"] = None
    pad_radius: Annotated[Annotated[float, msgspec.Meta(gt=0, le=1)] | None, "m"] = None
    modulus: Annotated[float, "Pa", msgspec.Meta(gt=0, le=1e15)] = 15.0e3
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, le=0.5)] = 0.5
    curvature: Annotated[float, "1/m", msgspec.Meta(le=1e6)] = 0.0

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        given = zip((self.pad_b, self.pad_m, self.pad_radius), pads.FINGERPADS[self.pad], strict=True)
        self.finger = pads.Fingerpad(*(named if own is None else own for own, named in given))
        if self.curvature <= -1.0 / self.finger.radius:
            raise SettingError(
                f"setting 'curvature' [1/m]: found {self.curvature}, expected more than {-1.0 / self.finger.radius:g}"
                f" (-1/pad_radius): the fingerpad does not fit into the hollow"
            )

    def start(self) -> None:
        self.grid = pin_grid(self.rows, self.columns, self.pitch).reshape(-1, 2)
        self.distance = np.sqrt(self.grid[:, 0] ** 2 + self.grid[:, 1] ** 2)
        self.pins = np.zeros(len(self.grid))
        self.shown = np.zeros(len(self.grid))
        self.shape = np.zeros(len(self.grid))
        self.actuator = 0.0
        self.frame: np.ndarray | None = None
        self._notes, self._cautioned = [], False
        times = self.rise_time, self.fall_time
        self.drives = Drives(self.stroke, self.travel, self.rate, self.actuator_rate, *times, self.resolution)
        if self.shows != "force":
            mesh = self.mesh()
            self.points, self.areas = mesh.vertices, mesh.areas
            self.spacing = float(np.sqrt(np.median(mesh.areas)))
            self.moved = np.zeros_like(self.points)
            self.tree = tree_of(self.points)

    def theory(self, force: np.ndarray | float, modulus: np.ndarray | float | None = None) -> pads.PadContact:
        """States of the fingerpad under forces [N] on tissue of this modulus [Pa]; default: the setting `modulus`."""
        curved = np.inf if self.curvature == 0.0 else 1.0 / self.curvature
        return pads.pad_contact(force, self.modulus if modulus is None else modulus, self.poisson, curved, self.finger)

    def step(
        self,
        contact: Annotated[Contact, Wants("force", "compression", "indentation", "foot", "normal")],
        surface: Annotated[Surface | None, Wants("nodes", "displacement", "pressure")],
        *,
        dt: float,
    ) -> Pins:
        touching = contact.force > 0.0
        approach, valid = self._from_force(contact.force if touching else 0.0)
        if self.shows != "force":
            self.frame = next_frame(self.frame, contact.normal)
            approach = max(contact.compression + contact.indentation, 0.0)
            valid = surface is not None
            if surface is not None and touching:
                if self.shows == "surface":
                    self._from_surface(contact, surface, approach)
                else:
                    valid = self._from_pressure(contact, surface)
        if touching and not valid and not self._cautioned and self.shows == "force":
            self._cautioned = True
            self._notes.append(
                f"PinArray: at {contact.force:.3g} N the contact is wider than Hertz theory allows (its radius is "
                f"above {pads.VALID_RATIO:g} times that of the fingerpad); the pins still follow it, with "
                "`valid: false`"
            )
        self.actuator, limited = drive(self.pins, self.shape, self.actuator, approach, dt, self.drives, self.shown)
        return Pins(
            heights=self.shown.reshape(self.rows, self.columns),
            actuator=self.actuator,
            limited=limited,
            valid=bool(valid and contact.force >= 0.0),
        )

    def _from_force(self, force: float) -> tuple[float, bool]:
        pad, compliance = self.finger, (1.0 - self.poisson**2) / self.modulus
        approach, radius = heights_from_force(
            self.distance, force, pad.b, pad.m, 1.0 / pad.radius, compliance, self.curvature, self.shape
        )
        return approach, radius <= pads.VALID_RATIO * pad.radius

    def _from_surface(self, contact: Contact, surface: Surface, approach: float) -> None:
        self._check(surface)
        foot, frame = np.array(contact.foot), self.frame
        assert frame is not None
        _, near = nearest(self.tree, foot + product(self.grid, frame[:2]), NEIGHBOURS)
        self.moved[surface.nodes] = surface.displacement
        tissue = einsum("nqi,ji->nqj", self.points[near] + self.moved[near] - foot, frame)
        self.moved[surface.nodes] = 0.0
        self.shape[:] = heights_from_surface(self.grid, tissue, approach, self.finger.radius, self.spacing)

    def _from_pressure(self, contact: Contact, surface: Surface) -> bool:
        if len(surface.pressure) != len(surface.nodes) or not len(surface.nodes):
            return False
        self._check(surface)
        assert self.frame is not None
        area = self.areas[surface.nodes]
        places = einsum("ik,jk->ij", self.points[surface.nodes] - np.array(contact.foot), self.frame[:2])
        radii = 1.2 * np.sqrt(area)
        heights_from_pressure(
            self.grid, places, surface.pressure * area, radii, self.finger.b, self.finger.m, self.shape
        )
        return True

    def _check(self, surface: Surface) -> None:
        if len(surface.nodes) and not 0 <= surface.nodes.min() <= surface.nodes.max() < len(self.points):
            raise SettingError(
                f"settings 'surface', 'vertices': surface {self.surface!r} has {len(self.points)} vertices, but the"
                f" tissue sends vertex {surface.nodes.max()}; give both nodes the same surface"
            )


def next_frame(frame: np.ndarray | None, normal: Vector3) -> np.ndarray:
    """The frame (3, 3) of `tangent_frame`, turned from the last normal to this one by the smallest rotation; None: the
    first."""
    if frame is None:
        return tangent_frame(normal)
    if tuple(frame[2]) == tuple(normal):
        return frame
    row = np.array(next_axis(tuple(frame[0]), tuple(frame[2]), tuple(normal)))
    return np.stack([row, np.cross(np.asarray(normal, float), row), np.asarray(normal, float)])


def tangent_frame(normal: Vector3) -> np.ndarray:
    """Right-handed frame (3, 3): directions of the rows and of the columns of pins, and the unit normal."""
    n = np.asarray(normal, float)
    row = np.array([0.0, 1.0, 0.0] if abs(n[0]) > 0.9 else [1.0, 0.0, 0.0])
    row -= np.sum(row * n) * n
    row /= length(row)
    return np.stack([row, np.cross(n, row), n])
