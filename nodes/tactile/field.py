"""What the skin feels beyond force (docs/equations/tactile-flow.md, docs/equations/subsurface.md)."""

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Contact, Friction, Load, Subsurface, Tactile, Vector
from palpate.nodes.base import Node, SettingError, Wants
from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.contact.subsurface import PAIRS, SHALLOWEST, strain_energy_density, under_patch, von_mises
from palpate.physics.contact.tactile import stick_radius
from palpate.physics.entry_point import NO_FLOATS
from palpate.physics.exact import length, product

TABLE = Path(__file__).parents[1] / "tables" / "fingertip.npz"


class Flow(Node):
    """Contact area and isostrain volumes of the fingertip under the normal force, and how fast they grow with it.

    They are read from curves that the layered fingertip gave against a plate (`palpate build fe fingertip`); between
    the recorded forces they are linear, beyond the last one they stay. Only what somebody reads is computed.
    """

    effect = "tactile"

    plate: Annotated[Literal["steel", "silicone"], "1"] = "silicone"
    """The plate that the curves were computed on: hard or soft."""
    friction: Annotated[float, "1", msgspec.Meta(gt=0)] = 0.5  # Coefficient above which the contact slides
    table: Annotated[str, "1"] = ""  # Path of a table in place of the shipped one

    def start(self) -> None:
        path = Path(self.table) if self.table else TABLE
        try:
            archive = read_arrays(path)
            force, area, volumes = (archive[f"{self.plate}.{name}"] for name in ("force", "area", "volumes"))
            self._levels = archive["levels"]
        except (ArchiveError, KeyError) as error:
            raise SettingError(f"setting 'table': {path}: {error}. `palpate build fe table` writes one") from None
        rows = force.size
        numbers = all(np.can_cast(array.dtype, float) for array in (force, area, volumes, self._levels))
        alike = force.shape == area.shape == (rows,) and volumes.shape == (rows, self._levels.size)
        every = np.column_stack([force, area, volumes]) if numbers and alike else np.full((1, 1), np.nan)
        if not np.isfinite(every).all() or rows < 2 or force[0] != 0.0 or (np.diff(force) <= 0).any():
            raise SettingError(
                f"setting 'table': {path}: expected finite curves over forces that rise from 0. "
                "`palpate build fe table` writes such a table"
            )
        self._area = self.wants("area") or self.wants("area_rate") or self.wants("stick_radius")
        self._volumes = self.wants("volumes") or self.wants("volume_rates")
        self._force = force
        curves = [area[:, None]] * self._area + [volumes] * self._volumes
        self._columns = np.column_stack(curves) if curves else np.zeros((rows, 0))
        self._slopes = np.diff(self._columns, axis=0) / np.diff(force)[:, None]
        self._flat = np.zeros(self._columns.shape[1])

    def step(
        self, contact: Annotated[Contact, Wants("force")], friction: Annotated[Friction | None, Wants("force")]
    ) -> Tactile:
        force = contact.force
        row = int(np.searchsorted(self._force, force, side="right")) - 1
        last = len(self._force) - 1
        if row >= last:
            value, slope = self._columns[last], self._flat
        else:
            slope = self._slopes[row]
            value = self._columns[row] + (force - self._force[row]) * slope
        area = rate = stick = 0.0
        if self._area:
            area, rate = float(value[0]), float(slope[0])
            if self.wants("stick_radius"):
                f = (0.0, 0.0, 0.0) if friction is None else friction.force
                aside = (f[0] * f[0] + f[1] * f[1] + f[2] * f[2]) ** 0.5
                stick = stick_radius((area / np.pi) ** 0.5, aside, force, self.friction)
        if not self._volumes:
            return Tactile(area=area, area_rate=rate, stick_radius=stick)
        return Tactile(
            area=area,
            area_rate=rate,
            levels=self._levels,
            volumes=value[int(self._area) :],
            volume_rates=slope[int(self._area) :],
            stick_radius=stick,
        )


class Stress(Node):
    """Stress, equivalent stress and strain energy density below the patch, at the depths of mechanoreceptors.

    Of an elastic half-space under the load that spread.Kernel makes: a constant matrix times its force. It is that of
    the tissue, and with their `young` and `poisson` of the skin of the finger. `radius` and `kernel` are those of
    spread.Kernel. In a graph that has no such node it costs nothing; `every: 10` runs it at a tenth of the rate.
    """

    effect = "tactile"

    radius: Annotated[float, "m", msgspec.Meta(gt=0)] = 8e-3  # Of the patch
    kernel: Annotated[Literal["biweight", "wendland", "cosine"], "1"] = "biweight"  # Shape of the pressure
    young: Annotated[float, "Pa", msgspec.Meta(gt=0)] = 19e3  # Enters the strain energy density alone
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, lt=0.5)] = 0.45
    depths: Annotated[Vector, "m"] = (0.5e-3, 1e-3, 2e-3)
    spacing: Annotated[float, "m", msgspec.Meta(gt=0)] = 2e-3  # Between points of a depth, which lie on a square grid
    reach: Annotated[float, "m", msgspec.Meta(ge=0)] = 10e-3  # Half of the grid's side

    def start(self) -> None:
        least, most = SHALLOWEST * self.radius, 10_000
        half = int(self.reach / self.spacing + 1e-9)
        if not self.depths or min(self.depths) < least:
            raise SettingError(f"setting 'depths': found {self.depths} m, expected depths of {least:.2g} m and more")
        count = (2 * half + 1) ** 2 * len(self.depths)
        if count > most:
            raise SettingError(f"settings 'reach', 'spacing', 'depths': found {count} points, expected at most {most}")
        line = self.spacing * np.arange(-half, half + 1)
        self._points = np.array([(x, y, z) for z in self.depths for x in line for y in line])
        tensor = under_patch(self._points, self.radius, self.kernel, self.poisson)
        self._matrix = np.stack([tensor[:, i, j] for i, j in PAIRS], axis=1).reshape(-1, 3)

    def step(self, load: Annotated[Load, Wants("forces", "normal")]) -> Subsurface:
        z = -np.array(load.normal)
        x = np.array((1.0, 0.0, 0.0) if abs(z[0]) < 0.8 else (0.0, 1.0, 0.0))
        x -= z * np.sum(x * z)
        x /= length(x)
        y = (z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0])
        axes = np.array((x, y, z))
        stress = product(self._matrix, product(axes, load.forces.sum(axis=0))).reshape(-1, len(PAIRS))
        return Subsurface(
            points=self._points,
            stress=stress,
            von_mises=von_mises(stress) if self.wants("von_mises") else NO_FLOATS,
            energy_density=(
                strain_energy_density(stress, self.young, self.poisson) if self.wants("energy_density") else NO_FLOATS
            ),
        )
