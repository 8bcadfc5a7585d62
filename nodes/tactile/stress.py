"""Stress below the patch (docs/equations/subsurface.md)."""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.exact import product
from palpate.compiler.records import floats, lend, put, vector
from palpate.messages import Load, Subsurface, Vector
from palpate.nodes.base import ARRAY, TABLE, Agrees, CompiledNode, Out, Part, SettingError, Wants
from palpate.nodes.base.kernels import ieee_kernel
from palpate.physics.contact import subsurface
from palpate.physics.contact.deflection import surface_under_patch

FINE = 4  # points per radius of the patch at which linear interpolation is wrong by up to 6 % of the peak


class Stress(CompiledNode):
    """Stress, equivalent stress and strain energy density below the patch, at the depths of mechanoreceptors.

    The stress of an elastic half-space under the load of spread.Kernel: a constant matrix times its force. It is that
    of the tissue or, with `young` and `poisson` of the skin, that of the finger. `radius` and `kernel` are those of
    spread.Kernel. The axes of the patch turn with its normal by the smallest rotation, also in the air, so that the
    receptors do not turn about the normal. `every: 10` runs the node at 10 % of the rate.
    """

    effect = "tactile"

    radius: Annotated[float, "m", msgspec.Meta(gt=0), Agrees(Load)] = 8e-3  # Of the patch
    kernel: Annotated[Literal["biweight", "wendland", "cosine", "hertz"], "1", Agrees(Load)] = "biweight"
    """Shape of the pressure."""
    young: Annotated[float, "Pa", msgspec.Meta(gt=0)] = 19e3  # Only affects the strain energy density
    poisson: Annotated[float, "1", msgspec.Meta(gt=-1, lt=0.5), Agrees(Subsurface)] = 0.45
    depths: Annotated[Vector, "m"] = (0.5e-3, 1e-3, 2e-3)
    spacing: Annotated[float, "m", msgspec.Meta(ge=0)] = 0.0
    """Between points of a depth, which lie on a square grid; 0: a quarter of the radius of the patch, or less."""
    reach: Annotated[float, "m", msgspec.Meta(ge=0)] = 10e-3  # Half of the grid's side

    mises = Part("tactile", "von_mises", about="The equivalent stress.")
    energy = Part("tactile", "energy_density", about="The strain energy density.")
    surface = Part("tactile", "deflection", about="The displacement of the surface.")
    State = {"matrix": TABLE, "points": TABLE, "stress": TABLE, "equivalent": ARRAY, "density": ARRAY,
             "above": TABLE, "deflection": TABLE,
             "axis": (3,), "normal": (3,)}  # fmt: skip
    """Matrix from force to stress; answers; matrix from force to displacement of the surface; x axis of the patch (0:
    none yet) and the normal to which it belongs."""

    def start(self) -> None:
        super().start()
        least, most = subsurface.SHALLOWEST * self.radius, 10_000
        if self.spacing:
            spacing, half = self.spacing, int(self.reach / self.spacing + 1e-9)
        else:  # divides `reach`
            half = math.ceil(FINE * self.reach / self.radius - 1e-9)
            spacing = self.reach / max(half, 1)
        if not self.depths or min(self.depths) < least:
            raise SettingError(f"setting 'depths': found {self.depths} m, expected depths of {least:.2g} m and more")
        count = (2 * half + 1) ** 2 * len(self.depths)
        if count > most:
            raise SettingError(
                f"settings 'reach', 'spacing', 'depths': found {count} points {1e3 * spacing:.3g} mm apart, expected "
                f"at most {most}: reduce 'reach', or the number of depths"
            )
        line = spacing * np.arange(-half, half + 1)
        points = np.array([(x, y, z) for z in self.depths for x in line for y in line])
        tensor = subsurface.under_patch(points, self.radius, self.kernel, self.poisson)
        matrix = np.stack([tensor[:, i, j] for i, j in subsurface.PAIRS], axis=1).reshape(-1, 3)
        self._caution(spacing, half)
        top = points[: (2 * half + 1) ** 2, :2]
        above = surface_under_patch(top, self.radius, self.kernel, self.poisson) if self.own["surface"] else top[:0]
        self.hold("above", np.ascontiguousarray(above.reshape(-1, 3)))
        self.hold("deflection", np.zeros((len(above), 3)))
        held = {"matrix": matrix, "points": points, "stress": np.zeros((count, len(subsurface.PAIRS)))}
        for name, array in (held | {"equivalent": np.zeros(count), "density": np.zeros(count)}).items():
            self.hold(name, np.ascontiguousarray(array))

    def _caution(self, spacing: float, half: int) -> None:
        """Note how wrong the stress between the points is, if they are coarse for the patch."""
        if half < 1 or FINE * spacing <= self.radius * (1.0 + 1e-9):
            return
        n = min(half, math.ceil(self.radius / spacing))
        part = np.arange(FINE * n + 1) / FINE
        at = np.array([(spacing * x, spacing * y, min(self.depths)) for x in part for y in part])
        found = subsurface.under_patch(at, self.radius, self.kernel, self.poisson)[:, 2, 2, 2].reshape(len(part), -1)
        to_fine = np.array([np.interp(part, np.arange(n + 1), row) for row in np.eye(n + 1)])
        between = product(product(to_fine.T, found[::FINE, ::FINE]), to_fine)
        wrong = np.abs(between - found).max() / np.abs(found).max()
        self._notes.append(
            f"Stress: its points are {1e3 * spacing:.3g} mm apart under a patch of {1e3 * self.radius:.3g} mm: between "
            f"them, where tactile.Afferents interpolates, the stress is up to {100 * wrong:.0f} % of its peak wrong; "
            f"leave out 'spacing', or set {250 * self.radius:.3g} mm or less"
        )

    @ieee_kernel
    def compute(own, load: Annotated[Load, Wants("forces", "normal")], out: Out[Subsurface], dt):
        out.delayed = load.delayed
        axis = subsurface.next_axis(vector(own.axis), vector(own.normal), vector(load.normal))
        put(own.axis, axis)
        put(own.normal, vector(load.normal))
        force = subsurface.along_patch(floats(load.forces), load.normal, axis)
        subsurface.response_to(force, floats(own.matrix), floats(own.stress))
        lend(out.points, own.points)
        lend(out.stress, own.stress)
        if own.surface:
            subsurface.response_to(force, floats(own.above), floats(own.deflection))
            lend(out.deflection, own.deflection)
        if own.mises:
            subsurface.von_mises_of(floats(own.stress), floats(own.equivalent))
            lend(out.von_mises, own.equivalent)
        if own.energy:
            subsurface.strain_energy_of(floats(own.stress), own.young, own.poisson, floats(own.density))
            lend(out.energy_density, own.density)
