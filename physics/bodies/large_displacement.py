"""What large displacement does to the force that indents a linear organ under a patch.

A load f spread over a patch of radius R indents the linear organ of modulus E by c f. The neo-Hookean one takes, for an
indentation s,

    f(s) = s/c (1 + rho(s/R)),    rho(q) = a1 q + a2 q² + a3 q³,    a_k = sum over j of A_kj nu^j

rho [1] is that of a half-space. The surface under the patch does not slide (u_t = 0); the load keeps its direction and
its shape, 3f/(pi R²) (1 - r²/R²)².

Source: A fitted to an axisymmetric finite-element solution (nine-node quadrilaterals, 10 across R, a cylinder of radius
and height 60 R) at eleven nu from 0 to 0.495 and q = 0.1, 0.2 ... 1.5, up to 1.0 below nu = 0.2. The fit is within
0.1 % of f; twice as many elements change f by 0.1 % up to q = 1.
Range: 0 <= nu < 0.5, q <= `DEEPEST`, an organ at least 5 R thick, no nodule or capsule within some R.

An organ under loads h of any kind is seen by the patch g through y = gCh/gCg: the force on the patch alone that would
indent it as much. With the linear organ's complementary energy hCh/2E the nonlinear one has

    V*(h) = hCh/2E + psi(y),    dpsi/df = s(f) - c f

whose displacement dV*/dh = (C/E)(h + k g), k = (s(y) - c y)/c, is that of the linear organ under k more load on the
patch. V* is convex as f(s) rises, whatever C: so the body is passive.

Below, x = c f/R is the linear organ's s/R. An empty `rho` is the linear organ.
"""

import numpy as np

from palpate.physics.exact import product
from palpate.physics.kernel import kernel

FIT = np.array(
    [
        [0.2572, -0.1463, -2.0361, 6.5652, -10.0373],
        [0.0143, -0.2078, 2.5323, -9.4548, 11.7778],
        [-0.0260, 0.1096, -0.8828, 3.0731, -3.4448],
    ]
)
"""[1] A, rows k = 1 ... 3, columns j = 0 ... 4."""
DEEPEST = 1.5  # [1] s/R up to which rho is known
STIFFER = 1.6
"""[1] Beyond, x goes on with its last slope and grows by `STIFFER` times the square of what s/R is deeper. That is an
extrapolation and no result: the body lets the finger through less and less."""


def nonlinearity(poisson: float) -> np.ndarray:
    """rho's coefficients a1, a2, a3 [1] at a Poisson's ratio from 0 to 0.5."""
    return product(FIT, np.multiply.accumulate([1.0, *4 * (poisson,)]))


@kernel
def linear_depth(depth, rho):
    """x [1] at s/R = `depth` [1], its slope and its curvature; linear below 0."""
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
def large_depth(x, rho):
    """s/R [1] where the linear organ's is x [1], and ds/dx/R [1], by Newton's method: x(s/R) is nearly straight."""
    depth = x
    if len(rho) == 0 or not x > 0.0:
        return depth, 1.0
    slope = 1.0
    for _ in range(50):
        reached, slope, _ = linear_depth(depth, rho)
        step = (x - reached) / slope
        depth = max(depth + step, 0.0)
        if abs(step) <= 1e-14 * depth:
            break
    return depth, 1.0 / slope


@kernel
def stored_energy(depth, rho):
    """Integral [1] of x over s/R from 0 to `depth` [1]: the energy that is held at s is R²/c times this."""
    if len(rho) == 0 or not depth > 0.0:
        return 0.5 * depth * depth
    q = min(depth, DEEPEST)
    energy = q * q * (0.5 + q * (rho[0] / 3.0 + q * (rho[1] / 4.0 + q * rho[2] / 5.0)))
    if depth > DEEPEST:
        over = depth - DEEPEST
        x, slope, _ = linear_depth(DEEPEST, rho)
        energy += over * (x + over * (0.5 * slope + STIFFER * over / 3.0))
    return energy
