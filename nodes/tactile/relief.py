"""Stress at the receptors while a relief slides under the skin (docs/equations/relief.md)."""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.records import floats, integers, lend, put, vector
from palpate.messages import Contact, Friction, Load, Proximity, Subsurface
from palpate.messages.record import array_handle
from palpate.nodes.base import ARRAY, TABLE, Agrees, Out, SettingError, Wants
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.textured import FRICTION, PATH, SLIDES, SLIP, WithTexture, advance, meet, slide
from palpate.nodes.tactile.receptors import WithReceptors, find_receptors
from palpate.physics.contact import subsurface
from palpate.physics.contact.spread import kernel_values
from palpate.physics.special import gauss_legendre
from palpate.physics.texture import relief

COARSE = 0.25  # [1] Share of the shortest wavelength that a step may pass
MOST_DEPTHS = 8


class Relief(WithReceptors, WithTexture):
    """Adds to the stress at the receptors what the relief of the surface adds while it slides under them.

    The heights of the texture load the skin, an elastic half-space: where the patch presses little, at the tops of the
    relief alone (docs/equations/relief.md). `surface` settings are those of texture.Spectral with `map: relief`, or a
    profile with heights; `direction`, across the ridges, is required, and the relief is fixed to the organ. The places
    of the receptors are those of tactile.Afferents, with `receptor_seed` for its `seed`. The friction force is not
    changed: texture.Spectral does that.
    """

    effect = "tactile"

    radius: Annotated[float, "m", msgspec.Meta(gt=0), Agrees(Load)] = 8e-3  # Of the patch
    kernel: Annotated[Literal["biweight", "wendland", "cosine", "hertz"], "1", Agrees(Load)] = "biweight"
    """Shape of the pressure."""
    skin_young: Annotated[float, "Pa", msgspec.Meta(gt=0)] = 50e3
    """Young's modulus of the skin: that of the published model of the afferents (docs/equations/relief.md)."""
    receptor_seed: Annotated[int, "1", msgspec.Meta(ge=0, lt=1 << 62)] = 1

    State = SLIDES | PATH | {
        "at": TABLE, "share": ARRAY, "layer": ARRAY, "corners": TABLE,
        "weights": TABLE, "table": array_handle(3), "skinned": array_handle(3), "full": (), "spacing": (),
        "stress": TABLE, "deflection": TABLE, "points": int, "bad": int, "axis_x": (3,), "normal": (3,),
        "fastest": (),
    }  # fmt: skip
    """Receptors; pressure of a newton at each [1/m²]; their depths in the table; interpolation of the stress; table
    `relief.Imprint` and its spacing [m]; answers; x axis of the patch and the normal to which it belongs; longest path
    of a step [m]."""

    shared = ("table", "skinned")

    def start(self) -> None:
        super().start()
        if not any(self.direction):
            raise SettingError(
                "setting 'direction': found none, expected the direction across the ridges of the relief"
            )
        if not self.is_relief:
            raise SettingError(
                "setting 'map': found a friction map, which has no heights; expected 'map: relief', or a profile with "
                "the column height"
            )
        made = self.receptors(self.receptor_seed)
        depths, layer = np.unique(made.at[:, 2], return_inverse=True)
        if len(depths) > MOST_DEPTHS:
            raise SettingError(
                f"setting 'units': found receptors at {len(depths)} depths, expected at most {MOST_DEPTHS}"
            )
        slope, spacing = self.period()
        try:
            height, spacing = relief.heights(slope, spacing, self.finest)
        except ValueError as error:
            raise SettingError(f"settings of the relief: {error}") from None
        table = relief.imprint(height, spacing, self.skin_young / (1.0 - self.poisson**2), self.poisson, depths)
        node, weight = gauss_legendre(64)
        q = 0.5 * (node + 1.0)
        total = np.pi * float(np.sum(weight * q * kernel_values(self.kernel, q))) * self.radius**2
        away = np.sqrt(made.at[:, 0] ** 2 + made.at[:, 1] ** 2) / self.radius
        held = {
            "at": made.at, "share": kernel_values(self.kernel, away) / total, "layer": layer.astype(np.int32),
            "corners": np.zeros((len(layer), 8), np.int32), "weights": np.zeros((len(layer), 8)),
            "table": table.stress, "skinned": table.surface, "stress": np.zeros((len(layer), 6)),
            "deflection": np.zeros((len(layer), 3)),
        }  # fmt: skip
        for name, array in held.items():
            self.hold(name, np.ascontiguousarray(array))
        self.own["full"], self.own["spacing"] = table.full, spacing
        self.own["axis"], self.own["motion"]["sampled"] = self.unit_direction, -1

    @ieee_kernel
    def compute(
        own, stress: Annotated[Subsurface, Wants("points", "stress", "deflection")],
        load: Annotated[Load, Wants("forces", "normal")], friction: Annotated[Friction, FRICTION],
        contact: Annotated[Contact, Wants("force")], proximity: Annotated[Proximity, SLIP], out: Out[Subsurface], dt,
    ):  # fmt: skip
        tensor, at, corners, weights = floats(stress.stress), floats(own.at), integers(own.corners), floats(own.weights)
        if not find_receptors(own, stress):
            return
        # where the relief is under the patch
        sliding, _, d, moved = slide(own, 0.0, friction, contact, proximity, dt)
        table, skinned, x = floats(own.table), floats(own.skinned), own.axis
        period = table.shape[1] * own.spacing
        along = sliding * (x[0] * d[0] + x[1] * d[1] + x[2] * d[2])
        meet(own, along, moved, dt, contact, proximity, friction, period)
        advance(own, along * dt, period)
        if contact.force > 0.0:
            own.fastest = max(own.fastest, abs(along) * dt)
        # the axis of the relief in the patch
        normal = vector(load.normal)
        a = subsurface.next_axis(vector(own.axis_x), vector(own.normal), normal)
        put(own.axis_x, a)
        put(own.normal, normal)
        u = x[0] * a[0] + x[1] * a[1] + x[2] * a[2]
        b = (
            a[1] * normal[2] - a[2] * normal[1],
            a[2] * normal[0] - a[0] * normal[2],
            a[0] * normal[1] - a[1] * normal[0],
        )
        v = x[0] * b[0] + x[1] * b[1] + x[2] * b[2]
        size = math.sqrt(u * u + v * v)
        c, s = (u / size, v / size) if size > 0.0 else (1.0, 0.0)
        forces, pressing = floats(load.forces), 0.0
        for k in range(len(forces)):
            pressing -= forces[k, 0] * normal[0] + forces[k, 1] * normal[1] + forces[k, 2] * normal[2]
        # each receptor: stress of the patch, and the fluctuation below the relief
        answer, moved_skin, surface = floats(own.stress), floats(own.deflection), floats(stress.deflection)
        share, layer, nu = floats(own.share), integers(own.layer), own.poisson
        for n in range(len(at)):
            for i in range(6):
                total = 0.0
                for k in range(8):
                    total += weights[n, k] * tensor[corners[n, k], i]
                answer[n, i] = total
            for i in range(3):
                total = 0.0
                for k in range(8 if len(surface) > 0 else 0):
                    total += weights[n, k] * surface[corners[n, k] % len(surface), i]
                moved_skin[n, i] = total
            place = (own.place + u * at[n, 0] + v * at[n, 1]) / own.spacing
            zz, xz, xx, down, side = relief.interpolate_imprint(
                table, skinned, own.full, layer[n], place, max(pressing, 0.0) * share[n]
            )
            yy = nu * (xx + zz)
            answer[n, 0] += c * c * xx + s * s * yy
            answer[n, 1] += s * s * xx + c * c * yy
            answer[n, 2] += zz
            answer[n, 3] += s * xz
            answer[n, 4] += c * xz
            answer[n, 5] += c * s * (xx - yy)
            moved_skin[n, 0] += c * side
            moved_skin[n, 1] += s * side
            moved_skin[n, 2] += down
        out.delayed = stress.delayed
        lend(out.points, own.at)
        lend(out.stress, own.stress)
        if len(surface) > 0:
            lend(out.deflection, own.deflection)

    def notes(self) -> list[str]:
        if self.known["fastest"] * self.finest > COARSE:
            self._note_once(
                f"Relief: a step moved the relief by {1e3 * self.own['fastest']:.2g} mm, where its shortest wavelength "
                f"is {1e3 / self.finest:.2g} mm: the spikes miss it. Raise the rate of the graph to "
                f"{4 * self.own['fastest'] * self.finest:.1f} times, or leave short wavelengths out"
            )
        return super().notes()
