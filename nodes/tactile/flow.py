"""Growth of the fingertip's contact with the force (docs/equations/tactile-flow.md)."""

import math
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.messages import Contact, Friction, Tactile
from palpate.nodes.base import Node, SettingError, Wants
from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.contact.tactile import stick_radius

TABLE = Path(__file__).parents[1] / "tables" / "fingertip.npz"


class Flow(Node):
    """Contact area and isostrain volumes of the fingertip under the normal force, and their derivatives by the force.

    They are interpolated in curves of the layered fingertip on a plate (`palpate build fe fingertip`): linear between
    the computed forces, constant beyond the last one. Only fields that are read are computed.
    """

    effect = "tactile"

    plate: Annotated[Literal["steel", "silicone"], "1"] = "silicone"
    """The plate of the curves: hard (steel) or soft (silicone)."""
    friction: Annotated[float, "1", msgspec.Meta(gt=0)] = 0.5  # Coefficient above which the contact slides
    table: Annotated[str, "1"] = ""  # Path of a table that replaces the shipped one

    def start(self) -> None:
        path = Path(self.table) if self.table else TABLE
        try:
            archive = read_arrays(path)
            force, area, volumes = (archive[f"{self.plate}.{name}"] for name in ("force", "area", "volumes"))
            levels = archive["levels"]
        except (ArchiveError, KeyError) as error:
            raise SettingError(f"setting 'table': {path}: {error}. `palpate build fe table` writes one") from None
        rows = force.size
        numbers = all(np.can_cast(array.dtype, float) for array in (force, area, volumes, levels))
        alike = force.shape == area.shape == (rows,) and volumes.shape == (rows, levels.size)
        every = np.column_stack([force, area, volumes]) if numbers and alike else np.full((1, 1), np.nan)
        if not np.isfinite(every).all() or rows < 2 or force[0] != 0.0 or (np.diff(force) <= 0).any():
            raise SettingError(
                f"setting 'table': {path}: expected finite curves over forces that rise from 0. "
                "`palpate build fe table` writes a table"
            )
        self._area = self.wants("area") or self.wants("area_rate") or self.wants("stick_radius")
        shown = self.wants("volumes") or self.wants("volume_rates")
        self._force, self._levels = force, levels if shown else levels[:0]
        curves = [area[:, None]] * self._area + [volumes] * shown
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
                aside = math.sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2])
                stick = stick_radius(math.sqrt(area / math.pi), aside, force, self.friction)
        return Tactile(
            area=area,
            area_rate=rate,
            levels=self._levels,
            volumes=value[int(self._area) :],
            volume_rates=slope[int(self._area) :],
            stick_radius=stick,
        )
