"""The quadratic tetrahedron, total Lagrangian: energy, nodal forces and tangent.

The plain element integrates W(F) + U(J) at four points. The mixed one evaluates U at the mean volume ratio of the
element (quadratic displacement, constant pressure, which is eliminated): no locking near incompressibility, and a
symmetric tangent. J. C. Simo, R. L. Taylor, K. S. Pister, Comput. Methods Appl. Mech. Eng. 51 (1985) 177-208.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.materials.invariants import cofactor, volume_tangent

_A, _B = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
POINTS = np.array([[_B, _B, _B], [_A, _B, _B], [_B, _A, _B], [_B, _B, _A]])
"""Natural coordinates of the integration points, of equal weight. Exact to degree 2."""


EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])


def shape(at: np.ndarray, edges: np.ndarray = EDGES) -> tuple[np.ndarray, np.ndarray]:
    """Shape functions (n,a) of a quadratic simplex and their natural gradients (n,a,d) at natural coordinates (n,d): of
    its corners, then of the middles of its edges."""
    corner = np.column_stack([1.0 - at.sum(axis=1), at])
    slope = np.vstack([-np.ones(at.shape[1]), np.eye(at.shape[1])])
    i, j = edges.T
    value = np.hstack([corner * (2.0 * corner - 1.0), 4.0 * corner[:, i] * corner[:, j]])
    middle = 4.0 * (corner[:, i, None] * slope[j] + corner[:, j, None] * slope[i])
    return value, np.concatenate([(4.0 * corner - 1.0)[:, :, None] * slope, middle], axis=1)


def gradients(points: np.ndarray, elements: np.ndarray, at: np.ndarray = POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Gradients of the shape functions in the undeformed body [1/m] (E,n,10,3), and det dX/dxi (E,n)."""
    _, natural = shape(at)
    jacobian = np.einsum("eai,nak->enik", points[elements], natural)
    return np.einsum("nak,enki->enai", natural, np.linalg.inv(jacobian)), np.linalg.det(jacobian)


@kernel
def _deformation(u, slope, small, F, C):
    """F = 1 + du/dX and C = cof F = dJ/dF at a point, from the displacements (10,3) of the element's nodes and the
    gradients (10,3) of its shape functions; returns J = det F."""
    for i in range(3):
        for j in range(3):
            x = 1.0 if i == j else 0.0
            for a in range(10):
                x += u[a, i] * slope[a, j]
            F[i, j] = x
    if small:
        for i in range(3):
            C[i, i] = 1.0
        return F[0, 0] + F[1, 1] + F[2, 2] - 2.0
    return cofactor(F, C)


@kernel
def _add_forces(P, C, slope, w, f, V):
    """Internal forces f_a += w P grad N_a, and derivative of the volume V_a += w cof F grad N_a."""
    for a in range(10):
        for i in range(3):
            x, y = 0.0, 0.0
            for j in range(3):
                x += P[i, j] * slope[a, j]
                y += C[i, j] * slope[a, j]
            f[a, i] += w * x
            V[a, i] += w * y


@kernel
def _add_stiffness(A, slope, w, T, K):
    """K_ab += w grad N_a A grad N_b, as two products (the first in T), only for b <= a: it is symmetric."""
    for a in range(10):
        for i in range(3):
            for s in range(9):
                x = 0.0
                for j in range(3):
                    x += slope[a, j] * A[3 * i + j, s]
                T[a, i, s] = w * x
    for a in range(10):
        for i in range(3):
            for b in range(a + 1):
                for k in range(3):
                    x = 0.0
                    for l in range(3):
                        x += T[a, i, 3 * k + l] * slope[b, l]
                    K[a, i, b, k] += x


@kernel
def _scatter(K, V, bulk, where, data):
    """Add the element's tangent, including bulk V x V for its mean volume ratio, to the blocks of its nodes."""
    for a in range(10):
        for b in range(a + 1):
            for i in range(3):
                for k in range(3):
                    x = K[a, i, b, k]
                    if bulk != 0.0:
                        x += bulk * V[a, i] * V[b, k]
                    data[where[a, b], i, k] += x
                    if a != b:
                        data[where[b, a], k, i] += x


@kernel
def integrate(law, gradient, weight, elements, displacement, p, mixed, small, tangent, where, force, data):
    """Energy, forces and tangent of elements of one material; returns the energy [J], and the first element with a
    volume ratio <= 0, or -1.

    law      from `compiled`; p its parameters
    gradient [1/m] (E,n,10,3), weight [m³] (E,n), elements (E,10), displacement [m] (N,3)
    where    (E,10,10) index in `data` of the block of each pair of nodes; used if `tangent`
    force    [N]   (N,3)    the internal forces are added
    data     [N/m] (B,3,3)  the tangent is added if `tangent`
    """
    total = 0.0
    many = weight.shape[1]
    P, A, F = np.zeros((3, 3)), np.zeros((9, 9)), np.zeros((many, 3, 3))
    C, J = np.zeros((many, 3, 3)), np.zeros(many)
    u, f = np.zeros((10, 3)), np.zeros((10, 3))
    K, T, V = np.zeros((10, 3, 10, 3)), np.zeros((10, 3, 9)), np.zeros((10, 3))
    for e in range(len(elements)):
        for a in range(10):
            for i in range(3):
                u[a, i] = displacement[elements[e, a], i]
        volume, mean = 0.0, 0.0
        for q in range(many):
            J[q] = _deformation(u, gradient[e, q], small, F[q], C[q])
            if not (small or J[q] > 0.0):
                return total, e
            volume += weight[e, q]
            mean += weight[e, q] * J[q]
        # mean dilatation (Simo, Taylor, Pister 1985): with `mixed`, U is a function of the element's mean J
        mean /= volume
        f[:] = 0.0
        V[:] = 0.0
        if tangent:
            K[:] = 0.0
        curve = 0.0
        for q in range(many):
            w = weight[e, q]
            # NaN: the law need not compute its tangent
            if not tangent:
                A[0, 0] = np.nan
            W, U, dU, ddU = law(F[q], mean if mixed else J[q], p, P, A)
            total += w * (W + U)
            # first Piola-Kirchhoff stress: P = dW/dF + U' cof F
            for i in range(3):
                for j in range(3):
                    P[i, j] += dU * C[q, i, j]
            _add_forces(P, C[q], gradient[e, q], w, f, V)
            if not tangent:
                continue
            # the volumetric part U'' cof F x cof F is local; with `mixed` it couples the element, see `_scatter`
            if mixed:
                curve, ddU = ddU, 0.0
            volume_tangent(F[q], C[q], 0.0 if small else dU, ddU, A)
            _add_stiffness(A, gradient[e, q], w, T, K)
        for a in range(10):
            for i in range(3):
                force[elements[e, a], i] += f[a, i]
        if tangent:
            _scatter(K, V, curve / volume, where[e], data)
    return total, -1
