"""A grid of tactile elements on the fingertip (docs/equations/sensors.md)."""

from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.records import floats, lend, put, vector
from palpate.messages import Load
from palpate.messages.tactile import TaxelForces
from palpate.nodes.base import ARRAY, TABLE, Agrees, Out, SettingError, Switch, Wants
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.sensor.sensing import Sensing, Share, measure
from palpate.physics.contact.subsurface import along_patch, next_axis
from palpate.physics.sensor.taxels import grid, neighbours, shares

MOST = 1024  # Taxels
Positive = msgspec.Meta(gt=0)


class Taxels(Sensing):
    """What the taxels on a fingertip report, normal and shear forces, from the load that `spread.Kernel` sends.

    Each taxel carries the part of the patch above it: its share of the force is the integral of the patch pressure over
    its square, and the shear is distributed as the pressure is. Forces outside the grid are lost. `radius` and `kernel`
    are those of spread.Kernel. The axes of the grid turn with the normal by the smallest rotation; forces are those of
    the tissue on the finger.

    rows, columns   of the grid, along its y and x axis
    spacing         between taxels, and the side of each
    force_range     full scale of each channel, to which the shares of the imperfections refer
    gain            standard deviation of the sensitivity of the taxels
    dead            share of the taxels that report nothing
    crosstalk       share of a taxel that each of its neighbours in rows and columns shows
    """

    radius: Annotated[float, "m", Positive, Agrees(Load)] = 8e-3  # Of the patch
    kernel: Annotated[Literal["biweight", "wendland", "cosine", "hertz"], "1", Agrees(Load)] = "biweight"
    rows: Annotated[int, "1", msgspec.Meta(ge=1, le=MOST)] = 4
    columns: Annotated[int, "1", msgspec.Meta(ge=1, le=MOST)] = 4
    spacing: Annotated[float, "m", Positive] = 4e-3
    force_range: Annotated[float, "N", Positive] = 2.0
    gain: Annotated[float, "1", Share, Switch("gain")] = 0.0
    dead: Annotated[float, "1", Share, Switch("dead_taxels")] = 0.0

    State = Sensing.State | {"positions": TABLE, "shares": ARRAY, "report": TABLE, "axis": (3,), "normal": (3,)}
    """Positions of the taxels [m] (n,2); share of the force on each, with its gain; the report; x axis of the grid
    (0: none yet) and the normal to which it belongs."""

    def scale(self) -> np.ndarray:
        return np.full(3 * self.rows * self.columns, self.force_range)

    def mixing(self, random: np.random.Generator) -> np.ndarray:
        near, axes = neighbours(self.rows, self.columns), np.eye(3)
        return (near[:, None, :, None] * axes[:, None, :]).reshape(3 * len(near), -1)

    def start(self) -> None:
        count = self.rows * self.columns
        if count > MOST:
            raise SettingError(f"settings 'rows', 'columns': found {count} taxels, expected at most {MOST}")
        super().start()
        random = np.random.Generator(np.random.PCG64((self.seed, 1)))
        positions = grid(self.rows, self.columns, self.spacing)
        gains = np.maximum(1.0 + self.gain * random.standard_normal(count), 0.0)
        gains[random.permutation(count)[: round(self.dead * count)]] = 0.0
        self.hold("positions", positions)
        self.hold("shares", gains * shares(positions, self.spacing, self.radius, self.kernel))
        self.hold("report", np.zeros((count, 3)))

    @ieee_kernel
    def compute(own, load: Annotated[Load, Wants("forces", "normal")], out: Out[TaxelForces], dt):
        out.delayed = load.delayed
        axis = next_axis(vector(own.axis), vector(own.normal), vector(load.normal))
        put(own.axis, axis)
        put(own.normal, vector(load.normal))
        force = along_patch(floats(load.forces), load.normal, axis)
        true, part, reported, report = floats(own.true), floats(own.shares), floats(own.reported), floats(own.report)
        for i in range(len(part)):
            true[3 * i] = -part[i] * force[0]
            true[3 * i + 1] = -part[i] * force[1]
            true[3 * i + 2] = part[i] * force[2]
        measure(own, dt)
        for i in range(len(part)):
            for k in range(3):
                report[i, k] = reported[3 * i + k]
        lend(out.positions, own.positions)
        lend(out.forces, own.report)
