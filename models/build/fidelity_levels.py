"""The fidelity levels of a sampled basis, which deformation.Adaptive switches between: the stiffness and the error of
each are fitted to training touches, against the body of all modes (docs/effects.md)."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np

from palpate.models.build.basis import Silent, Stages, check_writable
from palpate.models.fe.reduce.holdout import YOUNG, settled
from palpate.models.fe.reduce.reducible import Reducible
from palpate.models.fe.reduce.reduction import finger_touches, organ_touches
from palpate.models.fe.reduce.sampling import bent
from palpate.models.fe.reduce.snapshots import LoadPath, PressSolution, mirror
from palpate.nodes.deformation import Adaptive
from palpate.nodes.deformation.adaptive import beside
from palpate.nodes.deformation.basis_store import SHIPPED, cache
from palpate.physics.bodies.fidelity_bases import FidelityBases, cut
from palpate.physics.bodies.sampled.step import GAMMA, gamma
from palpate.physics.bodies.sampled_body import SampledBasis, SampledBody
from palpate.physics.geometry.mesh import Mesh

SIZES = (10, 20, 40, 60)
"""Modes of the levels; all modes are the last one."""
TOUCHES = 120
"""Training touches."""
SEEDS = (31, 32)
"""Of the training touches: half normal and half with any pull, and with the greatest."""
LEVELS = np.geomspace(1e-3, 1.0, 12)
"""Shares of the greatest load of a training touch."""
KNOTS = 12
MARGIN = 1.15
"""[1] What kappa is above the largest that the training touches ask for."""


def make(node: Adaptive, stages: Stages | None = None, commit: str | None = None) -> tuple[Path, dict[str, int]]:
    """Fit the levels of a node's basis and store them beside it. The file, and what was seen: touches, and states.

    SettingError: the basis is not stored, or nothing can be written beside it.
    """
    basis = node.basis()
    assert isinstance(basis, SampledBasis)  # its model is sampled
    stored = node.stored(SHIPPED, cache())
    assert stored is not None
    path = beside(stored[0])
    check_writable(path.parent)
    levels, seen = fitted(basis, training(basis, node.surface == "fingertip"), stages or Silent())
    about = {"basis": node.key(), "command": node.levels_command(), "commit": commit, "version": version("palpate")}
    levels.save(path, about | {"seeds": SEEDS, **seen})
    return path, seen


def training(basis: SampledBasis, finger: bool) -> list[LoadPath]:
    """Touches of both sides of the pulp, or all over an organ."""
    surface = Mesh(basis.vertices, basis.triangles)
    body = cast(Reducible, SimpleNamespace(surface=surface))  # touches read the surface alone
    if not finger:
        return organ_touches(body, TOUCHES, SEEDS[0])
    touches = finger_touches(body, 2 * TOUCHES // 3, SEEDS[0])
    touches += finger_touches(body, TOUCHES // 3, SEEDS[1], pulled=True)
    other = mirror(surface.vertices)
    touches[1::2] = [touch.mirrored(other) for touch in touches[1::2]]
    return touches


def fitted(basis: SampledBasis, touches: list[LoadPath], stages: Stages) -> tuple[FidelityBases, dict[str, int]]:
    """The levels of a basis, from states under the loads of these touches; and what was seen."""
    mesh = Mesh(basis.vertices, basis.triangles)
    sizes = [n for n in SIZES if n < basis.modes.shape[1]]
    bases = [cut(basis, r, basis.bend) for r in sizes] + [basis]
    # 1. press each touch with the bodies of all levels
    seen: list[list[tuple[float, ...]]] = []
    pressing = stages.begin("training", f"{len(touches)} touches, {len(bases)} bodies")
    for done, touch in enumerate(touches, 1):
        bodies = [SampledBody(own, mesh, YOUNG, 0.0, 5e-3, 1.0) for own in bases]
        nodes = np.flatnonzero(np.abs(touch.load).max(axis=1) > 0.0).astype(np.int32)
        pressed = PressSolution(touch, np.zeros(0))
        for level in LEVELS * touch.levels.max() * YOUNG:
            row = []
            for body in bodies:
                for _ in range(5):
                    now = settled(body, pressed, nodes, float(level))[3]
                    if body.settled:
                        break
                held, measure = body.held.ravel(), body.measure.ravel()
                bent_by = body.basis.residual_compliance @ held / YOUNG
                along, strain = float(measure @ bent_by), float(np.sqrt(max(held @ bent_by / YOUNG, 0.0)))
                in_modes = now - float(body._numbers[GAMMA]) * along
                row.append((now, in_modes, along, strain, body.linear))
            p = basis.modes.T @ bodies[-1].held.ravel() / YOUNG
            shares = [float(np.sqrt((p[r:] @ p[r:]) / (p @ p))) for r in sizes]
            if bodies[-1].settled:
                seen.append([*row, tuple(shares)])
        pressing(done / len(touches))
    # 2. of each level the residual compliance that fits the body of all modes, and its error beside two measures
    best = np.array([row[len(sizes)][0] for row in seen])
    bends, kappas, nus = [], [], []
    for k in range(len(sizes)):
        _, in_modes, along, strain, linear = np.array([row[k] for row in seen]).T
        some = along > 0.0
        weight = along / strain / best
        most = 2.0 * float(strain.max())
        few = np.flatnonzero(some)[:: max(1, int(some.sum()) // 400)]
        scale, power = bent(strain[few], ((best - in_modes) / along * strain)[few], weight[few])
        now = in_modes + along * np.array([gamma(w * w, scale, power, most)[0] for w in strain])
        bends.append((scale, power, most))
        nus.append(np.log(np.maximum(np.abs(linear / now - 1.0), 1e-6)))
        kappas.append(np.abs(now / best - 1.0) / np.array([row[-1][k] for row in seen]))
    # 3. a table of the largest error over the nonlinearity, with a margin
    low, high = np.quantile(np.concatenate(nus), [0.02, 1.0]).tolist()
    knots = np.linspace(low, high, KNOTS)
    table = np.zeros((len(sizes), KNOTS))
    for k in range(len(sizes)):
        for i in range(KNOTS):
            near = (nus[k] >= knots[max(i - 1, 0)]) & (nus[k] <= knots[min(i + 1, KNOTS - 1)])
            nearest = np.abs(nus[k] - knots[i]).argmin()
            table[k, i] = MARGIN * (kappas[k][near].max() if near.any() else kappas[k][nearest])
    return FidelityBases(np.array(sizes), np.array(bends), knots, table), {"touches": len(touches), "states": len(seen)}
