"""Nonlinear force of large indentation of an organ under a patch.

A load f on a patch of radius R indents the linear organ of modulus E by c f. For a neo-Hookean organ, the force at the
indentation s is

    f(s) = s/c (1 + rho(s/R)),    rho(q) = a1 q + a2 q² + a3 q³,    a_k = sum over j of A_kj nu^j

rho [1] is that of a half-space. The surface under the patch does not slide (u_t = 0); direction and shape of the load,
3f/(pi R²) (1 - r²/R²)², are constant.

Source: A is fitted to an axisymmetric finite-element solution (nine-node quadrilaterals, 10 across R, a cylinder of
radius and height 60 R) at eleven nu from 0 to 0.495 and q = 0.1, 0.2 ... 1.5, up to 1.0 below nu = 0.2. The error of
the fit is 0.1 % of f; twice as many elements change f by 0.1 % up to q = 1.
Range: 0 <= nu < 0.5, q <= `DEEPEST`, no nodule within a few R; under a capsule q <= `DEEPEST_COVERED`.

A finite organ is a half-space of compliance c_R in series with the rest c - c_R, of either sign, which is linear. To
first order in q this is the law above with R (c/c_R)² in place of R: both give s = c f - a1 (c_R f)²/R
(`condensed_step.stretched_radius`). Unlike in the series, s then rises with f for any c.

For an organ under any loads h, y = gCh/gCg is the force on the patch g that would indent it equally. With the
complementary energy hCh/2E of the linear organ, that of the nonlinear one is

    V*(h) = hCh/2E + psi(y),    dpsi/df = s(f) - c f

Its displacement dV*/dh = (C/E)(h + k g), k = (s(y) - c y)/c, is that of the linear organ with an additional load k on
the patch. V* is convex for any C because f(s) increases, so the body is passive.

Below, x = c f/R is s/R of the linear organ. An empty `rho` means the linear organ.
"""

import numpy as np

from palpate.compiler.exact import product
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array

FIT = np.array(
    [
        [0.2572, -0.1463, -2.0361, 6.5652, -10.0373],
        [0.0143, -0.2078, 2.5323, -9.4548, 11.7778],
        [-0.0260, 0.1096, -0.8828, 3.0731, -3.4448],
    ]
)
"""[1] A, rows k = 1 ... 3, columns j = 0 ... 4."""
DEEPEST = 1.5  # [1] s/R up to which rho is known
DEEPEST_COVERED = 0.3
"""[1] The same under a capsule, whose stretch `rho` does not contain: there the force is up to 4 % too small, 11 % at
0.75 (`fe.Solver`, 1 mm thick and ten times as stiff, R = 8 and 12 mm; benchmarks/large_strain.py)."""
NARROWEST = 0.5  # [1] Lower limit of (c/c_R)², for organs much stiffer than a half-space
STIFFER = 1.6
"""[1] Coefficient of the quadratic extrapolation of x beyond `DEEPEST`: an assumption, not a result of the fit. With it
the stiffness keeps increasing."""


def nonlinearity(poisson: float) -> np.ndarray:
    """Coefficients a1, a2, a3 [1] of rho at a Poisson's ratio from 0 to 0.5."""
    return product(FIT, np.multiply.accumulate([1.0, *4 * (poisson,)]))


@kernel
def linear_depth(depth: float, rho: Array):
    """x [1] at s/R = `depth` [1], and its first two derivatives; linear below 0."""
    if len(rho) == 0 or not depth > 0.0:
        return depth, 1.0, 0.0
    q = min(depth, DEEPEST)
    a, b, c = rho[0], rho[1], rho[2]
    x = q * (1.0 + q * (a + q * (b + q * c)))
    slope = 1.0 + q * (2.0 * a + q * (3.0 * b + q * 4.0 * c))
    if depth > DEEPEST:
        over = depth - DEEPEST
        return x + over * (slope + STIFFER * over), slope + 2.0 * STIFFER * over, 2.0 * STIFFER
    return x, slope, 2.0 * a + q * (6.0 * b + q * 12.0 * c)


@kernel
def large_depth(x: float, rho: Array):
    """s/R [1] for s/R = x [1] of the linear organ, and its derivative [1], by Newton's method on x(s/R)."""
    depth = x
    if len(rho) == 0 or not x > 0.0:
        return depth, 1.0
    slope = 1.0
    for _ in range(50):
        found, slope, _ = linear_depth(depth, rho)
        step = (x - found) / slope
        depth = max(depth + step, 0.0)
        if abs(step) <= 1e-14 * depth:
            break
    return depth, 1.0 / slope


@kernel
def stored_energy(depth: float, rho: Array):
    """Integral [1] of x over s/R from 0 to `depth` [1]; times R²/c it is the stored energy at s."""
    if len(rho) == 0 or not depth > 0.0:
        return 0.5 * depth * depth
    q = min(depth, DEEPEST)
    energy = q * q * (0.5 + q * (rho[0] / 3.0 + q * (rho[1] / 4.0 + q * rho[2] / 5.0)))
    if depth > DEEPEST:
        over = depth - DEEPEST
        x, slope, _ = linear_depth(DEEPEST, rho)
        energy += over * (x + over * (0.5 * slope + STIFFER * over / 3.0))
    return energy
