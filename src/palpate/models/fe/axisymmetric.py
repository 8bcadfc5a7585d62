"""A round body pressed along its axis, any material law: a cylinder between plates, a ball or a punch on a layer.

Nine-node quadrilaterals in the half plane (r, z), the volume ratio the mean of the element (`elements`), so nearly
incompressible laws do not lock. The meridian deformation has the gradient

    F = [[1 + du/dr, 0, du/dz], [0, 1 + u/r, 0], [dw/dr, 0, 1 + dw/dz]]

which the laws of `palpate.physics.materials` accept unchanged. A force-depth curve takes seconds instead of the minutes
of the tetrahedra of `Solver`; a fit needs many curves. Frictionless contact by a penalty.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from palpate.compiler.kernel import kernel
from palpate.physics.materials.compiled import compile_law, law_signature
from palpate.physics.materials.hyperelastic import Material, rest_moduli
from palpate.physics.materials.invariants import cofactor, volume_tangent

ROW, COLUMN = np.array([0, 0, 1, 2, 2]), np.array([0, 2, 1, 0, 2])  # Of the entries of F that are not zero
GAUSS, WEIGHT = np.polynomial.legendre.leggauss(3)
PENALTY = 300.0  # [1] Stiffness of contact times the size of a face, over the shear modulus
TOLERANCE = 1e-6  # [1] Residual over the size of the inner forces
ROUNDING = 5e-15  # [1] Residual due to rounding, over bulk modulus times the square of the outer radius
HALVED = 6  # Largest number of halvings of a step; then the press ends there


def _lagrange(x: float) -> tuple[np.ndarray, np.ndarray]:
    """Three quadratic shape functions on [-1, 1] and their slopes."""
    return np.array([0.5 * x * (x - 1), 1 - x * x, 0.5 * x * (x + 1)]), np.array([x - 0.5, -2 * x, x + 0.5])


@kernel
def _integrate(law, change, weight, p, mixed, cofactors, stress, moduli, curve):
    """Integrate the law at all points from the change of F's entries [1] (E,9,5). Returns False if a point is inverted.

    weight [m³] (E,9);  filled, times the weight: cofactors dJ/dF [m³] (E,9,5), stress dPsi/dF [J] (E,9,5), its
    derivatives [J] (E,9,5,5) if not empty, and U'' of the mean volume ratio over the volume [Pa/m³] (E,) if `mixed`
    """
    many, tangent = weight.shape[1], len(moduli) > 0
    P, A, F, C, J = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((many, 3, 3)), np.zeros((many, 3, 3)), np.zeros(many)
    for e in range(len(weight)):
        mean = 0.0
        for q in range(many):
            F[q] = np.eye(3)
            for m in range(5):
                F[q, ROW[m], COLUMN[m]] += change[e, q, m]
            J[q] = cofactor(F[q], C[q])
            if not (J[q] > 0.0 and F[q, 1, 1] > 0.0):
                return False
            mean += weight[e, q] * J[q]
        volume = np.sum(weight[e])
        mean /= volume
        for q in range(many):
            w = weight[e, q]
            A[0, 0] = 0.0 if tangent else np.nan
            _, _, dU, ddU = law(F[q], mean if mixed else J[q], p, P, A)
            for m in range(5):
                cofactors[e, q, m] = w * C[q, ROW[m], COLUMN[m]]
                stress[e, q, m] = w * P[ROW[m], COLUMN[m]] + dU * cofactors[e, q, m]
            if tangent:
                curve[e] = ddU / volume if mixed else 0.0
                volume_tangent(F[q], C[q], dU, 0.0 if mixed else ddU, A)
                for m in range(5):
                    for n in range(5):
                        moduli[e, q, m, n] = w * A[3 * ROW[m] + COLUMN[m], 3 * ROW[n] + COLUMN[n]]
    return True


@dataclass
class RoundBody:
    """A cylinder on z = 0 with nodes (ends and midpoints of its elements) at r in `across` and z in `up` [m]."""

    across: np.ndarray
    up: np.ndarray
    slides: bool = True  # whether it slides on its base or is bonded to it

    def __post_init__(self) -> None:
        m, n = len(self.across), len(self.up)
        self.points = np.stack([np.repeat(self.across, n), np.tile(self.up, m)], axis=1)
        number = np.arange(m * n).reshape(m, n)
        blocks = [number[i : i + 3, j : j + 3].ravel() for i in range(0, m - 1, 2) for j in range(0, n - 1, 2)]
        self.elements = np.array(blocks)
        self.top, self.side, self.base = number[:, -1], number[-1], number[:, 0]
        one = [_lagrange(x) for x in GAUSS]
        value = np.array([np.outer(a, b).ravel() for a, _ in one for b, _ in one])
        natural = np.array(
            [np.stack([np.outer(da, b).ravel(), np.outer(a, db).ravel()], 1) for a, da in one for b, db in one]
        )
        jacobian = np.einsum("eai,qak->eqik", self.points[self.elements], natural)
        radius = value @ self.points[:, 0][self.elements].T
        slope = np.einsum("qak,eqki->eqai", natural, np.linalg.inv(jacobian))
        # change of the entries of F by the displacements r, z of the nine nodes [1/m] (E,9,5,18)
        self.gradient = np.zeros((*slope.shape[:2], 5, 18))
        self.gradient[:, :, 0, ::2] = self.gradient[:, :, 3, 1::2] = slope[..., 0]
        self.gradient[:, :, 1, ::2] = self.gradient[:, :, 4, 1::2] = slope[..., 1]
        self.gradient[:, :, 2, ::2] = value[None] / radius.T[:, :, None]
        self.weight = np.linalg.det(jacobian) * np.outer(WEIGHT, WEIGHT).ravel() * 2.0 * math.pi * radius.T
        self.fixed = np.zeros_like(self.points, dtype=bool)
        self.fixed[self.points[:, 0] == 0.0, 0] = True
        self.fixed[self.base, 1] = True
        if not self.slides:
            self.fixed[self.base, 0] = True
        dof = (2 * self.elements[:, :, None] + np.arange(2)).reshape(-1, 18)
        self.rows, self.columns = np.repeat(dof, 18, axis=1).ravel(), np.tile(dof, (1, 18)).ravel()

    def forces(self, material: Material, u: np.ndarray, tangent: bool = True) -> tuple[np.ndarray, np.ndarray] | None:
        """Inner forces [N] (N,2) at displacements [m] (N,2), and the tangent [N/m] (E,18,18); None: inverted."""
        E, Q, _, _ = self.gradient.shape
        B = self.gradient.reshape(E, -1, 18)
        turned, change = B.swapaxes(1, 2), (B @ u[self.elements].reshape(E, 18, 1)).reshape(E, Q, 5)
        cofactors, stress = np.zeros((E, Q, 5)), np.zeros((E, Q, 5))
        moduli, curve = np.zeros((E if tangent else 0, Q, 5, 5)), np.zeros(E)
        law, p = compile_law(material.law, law_signature()), np.array(material.parameters)
        if not _integrate(law, change, self.weight, p, material.mixed, cofactors, stress, moduli, curve):
            return None
        force = np.zeros_like(u)
        np.add.at(force, self.elements, (turned @ stress.reshape(E, -1, 1)).reshape(E, 9, 2))
        if not tangent:
            return force, np.zeros((0, 18, 18))
        V = turned @ cofactors.reshape(E, -1, 1)
        return force, turned @ (moduli @ self.gradient).reshape(B.shape) + curve[:, None, None] * (V @ V.swapaxes(1, 2))

    def edges(self, line: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes (L,3) of the element edges of a line of nodes, shape functions (3,3) and areas [m²] (L,3) of points."""
        edge = np.stack([line[:-2:2], line[1::2], line[2::2]], axis=1)
        value = np.array([_lagrange(x)[0] for x in GAUSS])
        along = np.linalg.norm(self.points[edge[:, 2]] - self.points[edge[:, 0]], axis=1)
        area = math.pi * (self.points[edge, 0] @ value.T) * along[:, None] * WEIGHT
        return edge, value, area


@dataclass
class Indenter:
    """A plate, punch or ball that presses from above; its lowest point is at z = height of the body minus the depth."""

    held: np.ndarray  # nodes that move down with it: under a plate or a flat punch
    bonded: bool  # whether these keep their r
    line: np.ndarray  # nodes of the surface that it may touch elsewhere
    radius: float = math.inf  # [m] of its ball; inf: a plane

    def gap(self, x: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gap [m] (...) of points (...,2), its gradient (...,2) and second derivative (...,2,2)."""
        if math.isinf(self.radius):
            normal = np.broadcast_to([0.0, -1.0], x.shape)
            return level - x[..., 1], normal, np.zeros((*x.shape, 2))
        away = x - (0.0, level + self.radius)
        far = np.linalg.norm(away, axis=-1)
        normal = away / far[..., None]
        bend = (np.eye(2) - normal[..., None] * normal[..., None, :]) / far[..., None, None]
        return far - self.radius, normal, bend


def press_round(body: RoundBody, material: Material, indenter: Indenter, depths: Iterable[float]) -> np.ndarray:
    """Force [N] at increasing depths [m] (n,); NaN from the first depth without an equilibrium."""
    state = _AxisymmetricPress(body, material, indenter)
    forces: list[float] = []
    for depth in depths:
        forces.append(state.advance(float(depth)) if not forces or math.isfinite(forces[-1]) else math.nan)
    return np.array(forces)


class _AxisymmetricPress:
    def __init__(self, body: RoundBody, material: Material, indenter: Indenter) -> None:
        self.body, self.material, self.indenter = body, material, indenter
        self.fixed = body.fixed.copy()
        self.fixed[indenter.held, 1] = True
        self.fixed[indenter.held, 0] |= indenter.bonded
        self.free = np.flatnonzero(~self.fixed.ravel())
        self.edge, self.value, self.area = body.edges(indenter.line)
        self.penalty = PENALTY * rest_moduli(material)[0] / np.ptp(body.points[self.edge], axis=1).max(axis=1).min()
        self.u, self.depth, self.force = np.zeros_like(body.points), 0.0, 0.0
        self.floor = ROUNDING * rest_moduli(material)[1] * body.across[-1] ** 2
        self.last: tuple[float, np.ndarray] | None = None

    def advance(self, depth: float) -> float:
        step = depth - self.depth
        least = step / 2**HALVED
        if self.last is None and not len(self.indenter.held):
            step /= 8.0  # a ball makes its first contact
        while depth - self.depth > 1e-12 * depth:
            target = min(self.depth + step, depth)
            u = self._newton(target)
            if u is None:
                step *= 0.5
                if step < least:
                    return math.nan
                continue
            self.last = (target - self.depth, u - self.u)
            self.u, self.depth, step = u, target, 1.5 * step
        return self.force

    def _balance(self, u: np.ndarray, depth: float, tangent: bool = True) -> tuple[np.ndarray, np.ndarray] | None:
        """Unbalanced forces (N,2) and tangent blocks (E,18,18); those of contact in `touch` (L,6,6). None: inverted."""
        body, elastic = self.body, self.body.forces(self.material, u, tangent)
        if elastic is None:
            return None
        inner, K = elastic
        self.size = float(np.linalg.norm(inner))
        self.now = float(inner[body.base, 1].sum())
        place = np.einsum("qa,lai->lqi", self.value, (body.points + u)[self.edge])
        gap, normal, bend = self.indenter.gap(place, body.up[-1] - depth)
        touching = gap < 0.0
        pressure = np.where(touching, -self.penalty * gap * self.area, 0.0)
        np.subtract.at(inner, self.edge, np.einsum("lq,qa,lqi->lai", pressure, self.value, normal))
        stiff = np.where(touching, self.penalty * self.area, 0.0)[..., None, None] * (
            normal[..., None] * normal[..., None, :]
        )
        stiff = stiff - pressure[..., None, None] * bend
        self.touch = np.einsum("qa,qb,lqij->laibj", self.value, self.value, stiff).reshape(-1, 6, 6)
        return inner, K

    def _matrix(self, K: np.ndarray) -> csc_array:
        dof = (2 * self.edge[:, :, None] + np.arange(2)).reshape(-1, 6)
        rows = np.concatenate([self.body.rows, np.repeat(dof, 6, axis=1).ravel()])
        columns = np.concatenate([self.body.columns, np.tile(dof, (1, 6)).ravel()])
        size = self.body.points.size
        whole = csc_array((np.concatenate([K.ravel(), self.touch.ravel()]), (rows, columns)), shape=(size, size))
        return whole[self.free][:, self.free]

    def _newton(self, depth: float) -> np.ndarray | None:
        u = self.u.copy()
        if self.last is not None:
            u += (depth - self.depth) / self.last[0] * self.last[1]
        u[self.indenter.held, 1] = -depth
        state = self._balance(u, depth)
        for _ in range(25):
            if state is None:
                return None
            rest = state[0].ravel()[self.free]
            error = float(np.linalg.norm(rest))
            if not math.isfinite(error):
                return None
            if error <= max(TOLERANCE * self.size, self.floor):
                self.force = self.now
                return u
            try:
                way = np.zeros(u.size)
                way[self.free] = splu(
                    self._matrix(state[1]), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
                ).solve(-rest)
            except RuntimeError:  # singular
                return None
            length = 1.0
            while True:
                tried = self._balance(u + length * way.reshape(-1, 2), depth, tangent=False)
                if tried is not None:
                    now = float(np.linalg.norm(tried[0].ravel()[self.free]))
                    if now < (1.0 - 0.1 * length) * error or length < 0.1:
                        break
                length *= 0.5
                if length < 1e-3:
                    return None
            u = u + length * way.reshape(-1, 2)
            state = self._balance(u, depth)
        return None


def line(fine: float, count: int, end: float) -> np.ndarray:
    """Ends and middles of elements from 0 to `end` [m]: `count` even ones up to `fine`, then growing by 45 % each."""
    ends, size = np.linspace(0.0, fine, count + 1).tolist(), fine / count
    while ends[-1] < end * (1.0 - 1e-9):
        size *= 1.45
        left = end - ends[-1]
        ends.append(end if left < 1.6 * size else ends[-1] + size)
    return np.stack([ends, 0.5 * (np.array(ends) + np.array([*ends[1:], end]))], axis=1).ravel()[:-1]


def cylinder(radius: float, height: float, count: int) -> RoundBody:
    """The upper half of a cylinder [m], its symmetry plane at z = 0, `count` elements across."""
    return RoundBody(line(radius, count, radius), line(0.5 * height, max(count * 2 // 3, 3), 0.5 * height))


def layer(thickness: float, contact: float, count: int) -> RoundBody:
    """A wide layer [m] bonded to the ground, `count` even elements over the radius of the contact [m]."""
    wide = 4.0 * max(contact, thickness)
    up = line(contact, count, thickness) if contact < thickness else line(thickness, count, thickness)
    return RoundBody(line(contact, count, wide), thickness - up[::-1], slides=False)
