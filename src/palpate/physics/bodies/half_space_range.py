"""Validity of the half-space under a patch, and the error of the corrected compliance outside of it.

`true_patch` corrects for the wider load of the coarse surface (radius R_w instead of R) with a half-space. On a thin or
curved organ, for R_w up to 2 R, this leaves the relative error of the indentation

    thickness t   <= 0.2 (R_w²/R² - 1) (R/t)³   an elastic layer on a rigid base, bonded (nu = 0.45) or free to slide,
                                                by Hankel transforms (K. L. Johnson, Contact Mechanics, 1985, ch. 5.8)
    radius rho    <= 1.3 %                      an elastic ball, rho >= 1.5 R, nu 0.3 to 0.45, by Legendre series (A. I.
                                                Lurie, Three-Dimensional Problems of the Theory of Elasticity, 1964)
"""

import numpy as np

from palpate.compiler.exact import einsum, solve
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix
from palpate.physics.geometry.mesh import Mesh

FLAT = 2.0  # [1] Thickness and radius of curvature over R above which the ground counts as a half-space
NEAR_WIDTH = 0.7  # [1] Smallest R/R_w for which the load can be narrowed near another modulus
LAYER, BALL, INNERMOST = 0.2, 0.013, 1.5  # [1] Coefficients of the errors above; smallest known rho/R
LIGHT = 0.12  # [1] Force over E R² up to which the linear law is valid within 2 % for a surface that is free to slide
SLIDING = np.array([[0.0, 0.25, 0.49, 0.74, 0.99], [0.0, 0.04, 0.14, 0.25, 0.30]])
"""[1] f/(E R²), and relative excess stiffness of the linear law, by `fe.Solver` on the slab (R = 8 mm, nu = 0.45)."""
CAUSES = ("depth", "narrow", "thin", "curved", "near", "slides", "grown")
"""Limits of a condensed body; `caution` explains them."""
EDGE = 1e-9  # [1] Tolerance of ray casting at edges, so that no ray passes between two triangles
ROWS = 64  # Number of rays that are cast at once, which takes ROWS x T numbers


def inverse_thickness(mesh: Mesh) -> np.ndarray:
    """Inverse distance [1/m] (V,) from each vertex along its inward normal to the other side; 0 without another side.

    Ray casting: T. Moeller, B. Trumbore, J. Graphics Tools 2 (1997) 21-28."""
    a = mesh.vertices[mesh.triangles[:, 0]]
    e1, e2 = mesh.vertices[mesh.triangles[:, 1]] - a, mesh.vertices[mesh.triangles[:, 2]] - a
    out = np.zeros(len(mesh.vertices))
    least = 1e-3 * float(np.ptp(mesh.vertices, axis=0).max())
    for begin in range(0, len(out), ROWS):
        origin, ray = mesh.vertices[begin : begin + ROWS, None], -mesh.normals[begin : begin + ROWS, None]
        p = np.cross(ray, e2)
        det = einsum("tj,rtj->rt", e1, p)
        to = origin - a
        q = np.cross(to, e1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = einsum("rtj,rtj->rt", to, p) / det, einsum("rj,rtj->rt", ray[:, 0], q) / det
            away = einsum("tj,rtj->rt", e2, q) / det
            hit = (u > -EDGE) & (v > -EDGE) & (u + v < 1.0 + EDGE) & (away > least)
        out[begin : begin + ROWS] = 1.0 / np.where(hit, away, np.inf).min(axis=1)
    return out


def curvature(mesh: Mesh) -> np.ndarray:
    """Largest normal curvature [1/m] (V,) at each vertex, from the shape operator dn/dx fitted to its edges."""
    edges, _ = mesh.edges
    here, other = np.concatenate([edges, edges[:, ::-1]]).T
    n = mesh.normals
    x = mesh.vertices[other] - mesh.vertices[here]
    turn = n[other] - n[here]
    first = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = np.cross(n, first)
    (x1, x2), (t1, t2) = ([einsum("ej,ej->e", along, axis[here]) for axis in (first, second)] for along in (x, turn))
    # least squares for the symmetric matrix (p, q; q, r): t1 = p x1 + q x2, t2 = q x1 + r x2
    zero = np.zeros_like(x1)
    rows = np.stack([np.stack([x1, x2, zero], 1), np.stack([zero, x1, x2], 1)], 1)
    normal, right = np.zeros((len(n), 3, 3)), np.zeros((len(n), 3))
    np.add.at(normal, here, einsum("eki,ekj->eij", rows, rows))
    np.add.at(right, here, einsum("eki,ek->ei", rows, np.stack([t1, t2], 1)))
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(3) + 1e-300 * np.eye(3)
    p, q, r = solve(normal, right[..., None])[..., 0].T
    return np.abs(0.5 * (p + r)) + np.sqrt(0.25 * (p - r) ** 2 + q * q)


def thin_error(radius: float, wide: float, thick: float) -> float:
    """Bound [1] of the relative error of the indentation on ground of this thickness; all lengths in m."""
    return LAYER * max((wide / radius) ** 2 - 1.0, 0.0) * (radius / thick) * (radius / thick) * (radius / thick)


def curved_error(excess: float) -> str:
    """The same bound on curved ground, as text; `excess` is 2R/rho - 1."""
    return f"{BALL:.1%}" if FLAT / (1.0 + excess) >= INNERMOST else "more than 2 %; it is unknown below 1.5 radii"


def sliding_error(load: float) -> float:
    """Relative excess stiffness [1] of the linear law on a surface that is free to slide; `load` is f/(E R²)."""
    return float(np.interp(load, *SLIDING))


@kernel
def ground_under(ground: Matrix, order: Indices, touched: int, measure: Matrix):
    """Mean inverse thickness and curvature [1/m] under a patch, with the shares in the first column of `measure`."""
    thin = curved = 0.0
    for k in range(touched):
        v = order[k]
        thin += measure[v, 0] * ground[v, 0]
        curved += measure[v, 0] * ground[v, 1]
    return thin, curved


def narrow_error(narrower: float) -> float:
    """Bound [1] of the relative error of the indentation under a load too narrow for the fine mesh (`load_radius`),
    measured with the biweight kernel at random places of a triangulated plane: 1.4, 1 and fewer spacings wide."""
    return 0.1 if narrower < 0.05 else 0.25 if narrower < 0.6 else 1.0


def caution(cause: str, excess: float, radius: float, wide: float) -> str:
    """Explains that a step exceeds a limit (`CAUSES`) by `excess` [1], 0 at the limit, 1 at twice or half of it, and
    the expected error, for a load of this radius [m], which is `wide` [m] on the coarse surface."""
    patch, ground = f"a patch of {1e3 * radius:.2g} mm", FLAT * radius
    there, heavy, above = ground / (1.0 + excess), LIGHT * (1.0 + excess), f" by {excess:.0%}" if excess > 0.01 else ""
    return {
        "depth": f"the indentation exceeds the range of its law{above}: 1.5 radii of the load, 0.3 under a capsule; "
        "the error there is unknown, under a capsule the force is 11 % too small at 0.75 radii",
        "narrow": f"the load is narrower than its mesh resolves and acts like {patch}; the indentation may have an "
        f"error of {narrow_error(excess):.0%}. More vertices resolve it",
        "thin": f"under {patch} it is {1e3 * there:.2g} mm thick, expected at least {1e3 * ground:.2g} mm; the "
        f"indentation may have an error of {thin_error(radius, wide, there):.1%}",
        "curved": f"under {patch} its radius of curvature is {1e3 * there:.2g} mm, expected at least "
        f"{1e3 * ground:.2g} mm; the indentation may have an error of {curved_error(excess)}",
        "near": f"{patch} near another modulus, expected at least {1e3 * NEAR_WIDTH * wide:.2g} mm; the indentation "
        "may have an error of 20 %. A basis with more coarse vertices resolves it",
        "slides": f"its surface is free to slide (sticks: off) under {patch} with {heavy:.2g} E R², expected at most "
        f"{LIGHT:g} E R²; the body neglects the lateral motion of the surface and is too stiff by "
        f"{sliding_error(heavy):.0%}",
        "grown": f"the force exceeds the range of scene.surface.area{above}; the radius of the contact stays constant "
        "there",
    }[cause]
