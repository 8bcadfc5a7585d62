"""Tangential force of an indented body on a finger that moves along it, from an energy that depends on the place.

The stored energy of fingertip and body in series, at the approach e and the foot point p, is

    U(e, p) = min over s of  U1(e - s) + V(s, p),    V(s, p) = integral of f ds

Its derivative is a force along the surface, towards softer places:

    g = -dU/dp = -dV/dp at s = dV*/dp at f

Over a convex surface the bone edge x = p - e n moves less than p: with dn = S dp, dx = (1 - e S) dp, so that the force
on the hand is (1 - e S)^-1 g. Its work along a closed path is zero (negative with viscosity).

V is R²/c times the integral of x over s/R (`large_displacement`), in which c and R depend on the place:

    g = (V + k (f s - 2 V)) d ln c/dp,    k = d ln R/d ln c

A viscous body keeps the displacement u while the load F m(p) moves over it: the load's power is F m.u', the finger's
F (m.u)', so that g = F dm/dp.u. That is g at rest under the force y that holds u there, times F/y.

d ln c/dp is computed from the compliance c = g.Cg/E of the linear organ under a patch round each coarse vertex: the
gradient of this field, averaged over the patch. The gradient under the load itself would be a small difference of both
sides of the indentation, of the order of the discretization error.
"""

from typing import Annotated, Any, NamedTuple

import numpy as np

from palpate.compiler.exact import einsum, log, row_times
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.memory import stack_zeros
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector, Vector3
from palpate.physics.bodies.large_displacement import large_depth, stored_energy
from palpate.physics.bodies.loads.acting import acting_patch
from palpate.physics.bodies.loads.pairs import holding
from palpate.physics.bodies.loads.scattered import acting_radius
from palpate.physics.bodies.patch import normal_force
from palpate.physics.bodies.true_patch import Holds, gather_compliance, patch_compliance
from palpate.physics.contact.spread import Spreader, spread
from palpate.physics.geometry.mesh import Mesh

STEEPEST = 0.6  # [1] Limit of e S: beyond it the bone edge is near the centre of curvature, and the foot trails
MOST_ASIDE = 0.5  # [1] Limit of the tangential over the normal force
SUDDEN = 0.25
"""[1] The ratio of both forces changes by at most the motion over this multiple of the approach, so that the tangential
force changes by at most 1/SUDDEN + MOST_ASIDE times the secant stiffness f/e, times the motion."""


class Ground(NamedTuple):
    """The coarse surface; softness: logarithm of the linear organ's compliance under a patch round each vertex;
    holding: tangential force that holds this patch under a unit normal force."""

    normals: Annotated[np.ndarray, "<f8", 2]  # [1] (V,3)
    softness: Annotated[np.ndarray, "<f8", 1]  # [1] (V,)
    holding: Annotated[np.ndarray, "<f8", 2]  # [1] (V,3)
    rho: Annotated[np.ndarray, "<f8", 1]  # [1] of large displacement


def softness(mesh: Mesh, model: Any, spreader: Spreader) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Logarithm (V,) of the compliance under the spreader's patch round each vertex of a coarse mesh, for a modulus of
    1 Pa; the mean of all where a patch is empty. And the indentation by a force along the surface on this patch, per
    newton, over that by a normal force [1] (V,3). And the tangential force that holds this patch, per newton of normal
    force [1] (V,3). model: a `CondensedModel` whose fine mesh is the spreader's"""
    compliances, sideways = np.full(len(mesh.vertices), np.nan), np.zeros((len(mesh.vertices), 3))
    held = np.zeros_like(sideways)
    given = (np.ascontiguousarray(each) for each in (mesh.vertices, mesh.normals))
    _soften(*given, model, spreader, compliances, sideways, held)
    good = compliances > 0.0
    compliances[~good] = compliances[good].mean() if good.any() else 1.0
    return log(compliances), sideways, held


@ieee_kernel
def _soften(
    vertices: Matrix,
    normals: Matrix,
    model: Record,
    spreader: Spreader,
    compliances: Array,
    sideways: Matrix,
    held: Matrix,
):
    measure, block, narrow = np.zeros((len(vertices), 3)), np.zeros((3, 3)), np.zeros((3, 3))
    holds = Holds(np.zeros(3), np.zeros((2, 2)), np.zeros(2))
    order, marked = np.zeros(len(vertices), np.int64), np.zeros(len(vertices), np.bool_)
    for v in range(len(vertices)):
        n = normals[v]
        size = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        normal = (n[0] / size, n[1] / size, n[2] / size)
        inward = (-normal[0], -normal[1], -normal[2])
        # patch under a normal force at the vertex, and its measure on the coarse vertices
        count = spread(spreader, (vertices[v, 0], vertices[v, 1], vertices[v, 2]), normal, inward)
        if count == 0:
            continue
        nodes, forces, touched = spreader.nodes[:count], spreader.forces[:count], 0
        for k in range(count):
            press = row_times(forces[k], inward)
            for a in range(3):
                b = model.corners[nodes[k], a]
                measure[b, 0] += model.weights[nodes[k], a] * press
                marked[b] = True
        # list of the vertices with a measure
        for b in range(len(vertices)):
            if marked[b]:
                order[touched], marked[b] = b, False
                touched += 1
        # compliance of the linear organ under the patch, and its lateral displacement over the indentation
        total = normal_force(forces, normal)
        hats = gather_compliance(model.compliance, model.true.table, order, touched, measure, 0, block)
        radius, _, narrowed, scattered, wider = acting_patch(
            model, nodes, forces, normal, total, order, touched, measure, True
        )
        acts = acting_radius(radius, scattered, hats, wider)
        narrow[:] = block
        if narrowed or scattered > 0.0:
            hats = gather_compliance(model.compliance, model.true.table, order, touched, measure, 1, narrow)
        for i in range(3):
            for j in range(3):
                sideways[v, i] -= normal[j] * block[j, i]
        out = row_times(normal, sideways[v])
        body, more = patch_compliance(model.true, normal, acts, block, narrow, hats, holds)
        compliances[v] = body + more
        holding(holds, normal, held[v])
        for i in range(3):
            sideways[v, i] = (sideways[v, i] - out * normal[i]) / compliances[v]
        for k in range(touched):
            measure[order[k], :] = 0.0


def weight_slopes(mesh: Mesh, corners: np.ndarray) -> np.ndarray:
    """Gradients [1/m] (k,3,3) along the triangle of the barycentric weights of these corners (k,3)."""
    point = mesh.vertices[corners]
    normal = np.cross(point[:, 1] - point[:, 0], point[:, 2] - point[:, 0])
    square = np.maximum(einsum("ij,ij->i", normal, normal), 1e-300)[:, None]
    across = (np.cross(normal, point[:, (a + 2) % 3] - point[:, (a + 1) % 3]) / square for a in range(3))
    return np.ascontiguousarray(np.stack(list(across), axis=1))


def surface_gradient(mesh: Mesh, values: np.ndarray) -> np.ndarray:
    """Gradient [1/m] (V,k,3) along the surface of the piecewise linear field with these values (V,k), at each vertex:
    mean over its triangles, weighted with their areas."""
    triangles = mesh.triangles
    area = np.linalg.norm(mesh.face_vectors, axis=1)
    slopes = einsum("t,tai,tak->tki", area, weight_slopes(mesh, triangles), values[triangles])
    total, weight = np.zeros((*values.shape, 3)), np.zeros(len(values))
    for a in range(3):
        np.add.at(total, triangles[:, a], slopes)
        np.add.at(weight, triangles[:, a], area)
    return total / np.maximum(weight, 1e-300)[:, None, None]


@kernel
def along(
    ground: Ground,
    nodes: Indices,
    touched: int,
    tilt: Matrix,
    normal: Vector3,
    radius: float,
    power: float,
    compliance: float,
    force: float,
    press: float,
    gradient: Array,
    shape: Matrix,
):
    """Fill `gradient` [N] (3), g, and `shape` [1/m] (3,3), the shape operator S, under a load.

    nodes, touched   coarse vertices of the patch, and their number
    tilt             [1/m] (V,3) derivatives of their shares along the surface
    normal [1] (3);  radius [m] of the law of large displacement, and k [1];  compliance [m/N] of the linear organ under
    the patch;  force [N] F along the normal;  press [N] y, the one that holds the present indentation at rest
    """
    gradient[:] = 0.0
    shape[:] = 0.0
    if not (force > 0.0 and press > 0.0 and compliance > 0.0):
        return
    softer = stack_zeros((3,))
    # derivatives of the patch's mean log compliance and mean normal along the surface
    for a in range(touched):
        v = nodes[a]
        for i in range(3):
            grad = tilt[v, i]
            softer[i] += grad * ground.softness[v]
            for j in range(3):
                shape[j, i] += grad * ground.normals[v, j]
    depth, _ = large_depth(compliance * press / radius, ground.rho)
    energy = radius * radius / compliance * stored_energy(depth, ground.rho)
    energy += power * (press * radius * depth - 2.0 * energy)
    for i in range(3):
        gradient[i] = force * (energy / press) * softer[i]
    # without the part along the normal, which is work of the normal force
    out = gradient[0] * normal[0] + gradient[1] * normal[1] + gradient[2] * normal[2]
    for i in range(3):
        gradient[i] -= out * normal[i]


@kernel
def on_hand(gradient: Vector3, shape: Vector, approach: float, normal: Vector3):
    """Tangential force on the hand (1 - e S)^-1 g [N] (3 numbers), from g [N] (3), S [1/m] (9) row by row, and the
    depth e [m] of the bone edge below the foot point, negative above; |e S| is limited to `STEEPEST`."""
    size = 0.0
    for k in range(9):
        size += shape[k] * shape[k]
    most = STEEPEST / max(np.sqrt(size), 1e-12)
    deep = min(max(approach, -most), most)
    force = stack_zeros((3,))
    for _ in range(40):  # Neumann series; the error decreases by the factor STEEPEST in each iteration
        for i in range(3):
            force[i] = gradient[i] + deep * (shape[i] * force[0] + shape[3 + i] * force[1] + shape[6 + i] * force[2])
    out = force[0] * normal[0] + force[1] * normal[1] + force[2] * normal[2]
    return force[0] - out * normal[0], force[1] - out * normal[1], force[2] - out * normal[2]


@kernel
def limit_tangential(lateral: Vector3, force: float, motion: float, approach: float, ratio: Array):
    """The tangential force [N] (3 numbers) within its limits for a normal `force` [N] > 0; updates `ratio` [1] (3), the
    tangential over the normal force: at most `MOST_ASIDE`, changed by at most motion/(`SUDDEN` approach).

    motion [m] of the finger and the tissue in this step;  approach [m] > 0
    """
    aside = np.sqrt(lateral[0] ** 2 + lateral[1] ** 2 + lateral[2] ** 2)
    inside = min(1.0, MOST_ASIDE * force / aside) if aside > 0.0 else 1.0
    square = 0.0
    for k in range(3):
        square += (inside * lateral[k] / force - ratio[k]) ** 2
    change, most = np.sqrt(square), motion / (SUDDEN * approach)
    if change <= most and inside == 1.0:  # the usual case, without rounding
        ratio[0], ratio[1], ratio[2] = lateral[0] / force, lateral[1] / force, lateral[2] / force
        return lateral
    share = min(1.0, most / change) if change > 0.0 else 1.0
    for k in range(3):
        ratio[k] += share * (inside * lateral[k] / force - ratio[k])
    return ratio[0] * force, ratio[1] * force, ratio[2] * force
