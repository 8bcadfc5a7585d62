"""What laws in the principal stretches share: stress and tangent, from the Kirchhoff stresses and their slopes."""

import numpy as np

from palpate.physics.kernel import kernel


@kernel
def principal_stress(F, c, N, tau, curve, P, A):
    """P = dW/dF and, where it is wanted, A = d2W/dF2 of an energy in the logarithms of the principal stretches.

    c      [1]  (3,)   eigenvalues of F'F, squares of the stretches; N (3,3) its eigenvectors, in columns
    tau    [Pa] (3,)   principal Kirchhoff stresses dW/d(ln stretch)
    curve  [Pa] (3,3)  their slopes by the three logarithms
    P, A               as in `hyperelastic`; NaN at A[0, 0]: no tangent

    R. W. Ogden, Non-Linear Elastic Deformations (1984), 6.1.4.
    """
    S = tau / c  # second Piola-Kirchhoff, in its own frame
    M = F @ N  # rows i, columns in the principal frame
    full = N @ np.diag(S) @ N.T
    turned = F @ full
    for i in range(3):
        for j in range(3):
            P[i, j] = turned[i, j]
    if np.isnan(A[0, 0]):
        return
    spread = np.zeros((3, 3))  # (S_b - S_a)/(c_b - c_a), its limit where two stretches are equal
    for a in range(3):
        for b in range(3):
            if a != b:
                gap = c[b] - c[a]
                if abs(gap) > 1e-7 * (c[a] + c[b]):
                    spread[a, b] = (S[b] - S[a]) / gap
                else:
                    spread[a, b] = 0.5 * (curve[b, b] - curve[a, b] - tau[a] - tau[b]) / (c[a] * c[b])
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for l in range(3):
                    total = full[j, l] if i == k else 0.0
                    for a in range(3):
                        for b in range(3):
                            slope = curve[a, b] - (2.0 * tau[a] if a == b else 0.0)
                            total += slope / (c[a] * c[b]) * M[i, a] * N[j, a] * M[k, b] * N[l, b]
                            if a != b:
                                total += spread[a, b] * M[i, a] * N[j, b] * (M[k, a] * N[l, b] + M[k, b] * N[l, a])
                    A[3 * i + j, 3 * k + l] = total
