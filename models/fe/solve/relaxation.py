"""Relaxation of any material law in full finite elements: quasi-linear viscoelasticity by a Prony series.

    S = (1 - sum g_i) S_e(C) + sum H_i,    tau_i H_i' + H_i = g_i tau_i S_e',    S_e = F^-1 dW/dF

The part of the stress that sees shape relaxes, that which sees volume does not. Over a load step, which is a time here,
S_e is taken to change evenly, so the step is of second order and holds for any length:

    H_i <- exp(-x) H_i + g_i (1 - exp(-x))/x (S_e - S_e before),    x = dt/tau_i

G. A. Holzapfel, Int. J. Numer. Methods Eng. 39 (1996) 3903-3926.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.models.fe.element.elements import gradients
from palpate.models.fe.element.mesh import TetMesh
from palpate.models.fe.sparse.pattern import Pattern
from palpate.physics.kernel import kernel
from palpate.physics.materials.compiled import LAW, compiled
from palpate.physics.materials.hyperelastic import Material
from palpate.physics.materials.invariants import cofactor
from palpate.physics.materials.prony import Prony


@kernel
def _deform(F, displacement, nodes, slope):
    for i in range(3):
        for j in range(3):
            F[i, j] = 1.0 if i == j else 0.0
    for a in range(10):
        for i in range(3):
            for j in range(3):
                F[i, j] += displacement[nodes[a], i] * slope[a, j]


@kernel
def _elastic(law, gradient, elements, displacement, p, small, stress):
    """S_e = F^-1 dW/dF [Pa] (E,n,3,3) into `stress`."""
    P, A, F, C = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((3, 3)), np.zeros((3, 3))
    for e in range(len(elements)):
        for q in range(gradient.shape[1]):
            _deform(F, displacement, elements[e], gradient[e, q])
            A[0, 0] = np.nan
            J = cofactor(F, C)
            law(F, J, p, P, A)
            for i in range(3):
                for j in range(3):
                    turned = C[0, i] * P[0, j] + C[1, i] * P[1, j] + C[2, i] * P[2, j]
                    stress[e, q, i, j] = P[i, j] if small else turned / J


@kernel
def _add(law, gradient, weight, elements, displacement, p, small, share, history, tangent, where, force, data):
    """Add (share - 1) dW/dF + F history: what relaxation changes of the elastic forces."""
    P, A, F, C = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((3, 3)), np.zeros((3, 3))
    for e in range(len(elements)):
        for q in range(gradient.shape[1]):
            _deform(F, displacement, elements[e], gradient[e, q])
            A[0, 0] = 0.0 if tangent else np.nan
            law(F, cofactor(F, C), p, P, A)
            H, w, slope = history[e, q], weight[e, q], gradient[e, q]
            for i in range(3):
                for j in range(3):
                    turned = F[i, 0] * H[0, j] + F[i, 1] * H[1, j] + F[i, 2] * H[2, j]
                    P[i, j] = (share - 1.0) * P[i, j] + (H[i, j] if small else turned)
            for a in range(10):
                for i in range(3):
                    pull = slope[a, 0] * P[i, 0] + slope[a, 1] * P[i, 1] + slope[a, 2] * P[i, 2]
                    force[elements[e, a], i] += w * pull
            if not tangent:
                continue
            A *= share - 1.0
            if not small:
                for i in range(3):
                    for j in range(3):
                        for k in range(3):
                            A[3 * i + j, 3 * i + k] += H[j, k]
            for a in range(10):
                for b in range(10):
                    for i in range(3):
                        for k in range(3):
                            total = 0.0
                            for j in range(3):
                                for l in range(3):
                                    total += slope[a, j] * A[3 * i + j, 3 * k + l] * slope[b, l]
                            data[where[e, a, b], i, k] += w * total


class Relaxation(ContactPair):
    """Relaxing regions, for `fe.Solver` among its contacts; the load of `advance` is then the time [s].

        relaxing = Relaxation(mesh, materials, {0: Prony([0.5], [2.0])})
        body = Solver(mesh, materials, fixed, held, contacts=[ball, relaxing])

    materials  by region number, as the solver has them: the laws of an instant
    series     by region number; other regions do not relax
    """

    def __init__(self, mesh: TetMesh, materials: Mapping[int, Material], series: Mapping[int, Prony]) -> None:
        self._time = 0.0
        self._parts = []
        for region, prony in series.items():
            own = np.flatnonzero(mesh.region == region)
            slope, det = gradients(mesh.points, mesh.elements[own])
            stress = np.zeros((*det.shape, 3, 3))
            history = np.zeros((len(prony.times), *stress.shape))
            self._parts.append((materials[region], prony, mesh.elements[own], slope, det / 24.0, stress, history))

    def bind(self, points: np.ndarray, pattern: Pattern, stiffness: np.ndarray) -> None:
        self.couple(pattern)

    def couple(self, pattern: Pattern) -> None:
        self._where = [pattern.where(elements) for _, _, elements, *_ in self._parts]

    def nodes(self) -> np.ndarray:
        return np.zeros(0, dtype=np.int64)

    def begin(self, displacement: np.ndarray, load: float) -> None:
        """Take the converged state into the history, once."""
        dt, self._time = load - self._time, load
        if dt == 0.0:
            return
        for law, prony, elements, slope, _, stress, history in self._parts:
            before = stress.copy()
            _elastic(compiled(law.law, LAW), slope, elements, displacement, np.array(law.parameters), law.small, stress)
            left, fresh = prony.step(dt)
            for i, share in enumerate(prony.shares):
                history[i] = left[i] * history[i] + share * fresh[i] * (stress - before)

    def add(self, displacement: np.ndarray, load: float, tangent: bool, force: np.ndarray, data: np.ndarray) -> None:
        """ValueError: a load that goes back in time."""
        dt = load - self._time
        if dt < 0.0:
            raise ValueError(f"load {load:.6g}: before {self._time:.6g}; with relaxation the load is a time [s]")
        for (law, prony, elements, slope, weight, stress, history), where in zip(self._parts, self._where, strict=True):
            left, fresh = prony.step(dt)
            share = 1.0 - prony.shares @ (1.0 - fresh)
            kept = np.tensordot(left, history, 1) - (prony.shares @ fresh) * stress
            _add(
                compiled(law.law, LAW), slope, weight, elements, displacement, np.array(law.parameters), law.small,
                share, kept, tangent, where, force, data,
            )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """Time, stress and history of each region."""
        arrays = {f"{name}{k}": part[5 + i] for k, part in enumerate(self._parts) for i, name in enumerate(("s", "h"))}
        return {"time": np.array(self._time), **arrays}

    def restore(self, state: dict[str, Any]) -> None:
        self._time = float(state["time"])
        for k, part in enumerate(self._parts):
            part[5][:], part[6][:] = state[f"s{k}"], state[f"h{k}"]
