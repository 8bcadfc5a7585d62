"""A finite-element organ condensed to its surface, one implicit viscoelastic step at a time.

Full model: K u = f, linear, u displacements, f surface loads. Condensed to the vertices of a coarse surface mesh (loads
spread over the triangles round a vertex, displacements averaged the same way) it is

    u = C h/E,        tau dh/dt + h = f

C [m/N] (3V,3V) is the compliance for a modulus of 1 Pa, E the organ's modulus, tau the retardation time of a
Kelvin-Voigt solid whose damping is proportional to its stiffness. Backward Euler: h <- (tau h + T f)/(T + tau). C is
symmetric and positive, so a step is passive whatever its length: the work done on the body is at least the growth of
the energy h.C h/(2E) that it stores. Only the vertices that carry load now or did a few tau ago hold any h, so that a
step costs what the contact covers, not what the mesh holds.

The patch itself has the compliance of the true load in place of that of the coarse vertices' wider one
(`physics.bodies.true_patch`): V* = h.C h/2E + (c - g.C g/E) y²/2, y the normal force on the patch that h stands for.

With dents (`indentation_table`) the organ is nonlinear under the patch: u = dV*/dh instead of C h/E. Its V* is convex,
so the same step stays passive at a place: the load's work is at least the growth of h.u - V*.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from palpate.physics.archive import ArchiveError, read_arrays
from palpate.physics.bodies.half_space_range import CAUSES, FLAT, LIGHT, NEAR_WIDTH, caution, ground_under
from palpate.physics.bodies.indentation_table import SPACING, hat_moments, patch_radius, rise, risen
from palpate.physics.bodies.patch import barycentric, carried, normal_force, reaches, share_of
from palpate.physics.bodies.place_energy import Ground, along, held, softness, weight_slopes
from palpate.physics.bodies.true_patch import (
    TruePatch,
    dent_at,
    draw_together,
    load_radius,
    patch_compliance,
    true_patch,
    uncorrected,
)
from palpate.physics.contact.spread import Spreader
from palpate.physics.entry_point import NO_NODES, NO_VECTORS, entry_point
from palpate.physics.geometry.graded import ranges
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.kernel import kernel

FORGOTTEN = 1e-9
"""[N] Remaining load below which a vertex is dropped."""
LEAST_FORCE = 1e-3
"""[N] Least force that the terminal law is taken at."""


@dataclass(frozen=True)
class Basis:
    """Static condensation of an organ to its surface.

    vertices    [m]   (V,3) of the coarse surface, in the organ's frame
    triangles   [1]   (T,3)
    compliance  [m/N] (3V,3V) float32, for a modulus of 1 Pa
    dents       [1]   (V,L) see `indentation_table`; L = 0 where only the linear organ is known
    """

    vertices: np.ndarray
    triangles: np.ndarray
    compliance: np.ndarray
    dents: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    def save(self, path: Path, about: str = "") -> None:
        """Write the lower half in steps of the largest entry over 32767, high bytes and low ones apart: so they
        pack; and a text that says what it was made from."""
        step = float(np.abs(self.compliance).max()) / 32767
        lower = np.rint(self.compliance[np.tril_indices(len(self.compliance))] / step).astype("<i2")
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part.npz")
        np.savez_compressed(
            part, vertices=self.vertices, triangles=self.triangles, step=np.float64(step),
            lower=np.ascontiguousarray(lower.view(np.uint8).reshape(-1, 2).T),
            dents=self.dents.astype(np.float32), about=np.array(about),
        )  # fmt: skip
        part.replace(path)

    @classmethod
    def load(cls, path: Path) -> Basis:
        """Read a stored basis.

        ArchiveError: not a basis, or a damaged one.
        """
        try:
            archive = read_arrays(path)
            vertices, triangles = archive["vertices"], archive["triangles"]
            size = 3 * len(vertices)
            lower = np.ascontiguousarray(archive["lower"].T).view("<i2").ravel()
            if lower.size != size * (size + 1) // 2:  # before room is made for all of the matrix
                raise ValueError(f"{lower.size} compliances for {len(vertices)} vertices")
            full = np.zeros((size, size), dtype=np.float32)
            full[np.tril_indices(size)] = lower * np.float32(archive["step"])
            dents = archive["dents"].astype(np.float64) if "dents" in archive else np.zeros((0, 0))
            if dents.size and (len(dents) != len(vertices) or not np.isfinite(dents).all()):
                raise ValueError(f"dents of shape {dents.shape} for {len(vertices)} vertices")
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, MemoryError) as error:
            raise ArchiveError(f"{path}: not a reduced basis: {error}. Rebuild it with `palpate reduce`") from None
        full += np.tril(full, -1).T
        return cls(vertices, triangles, full, dents)


class CondensedModel(NamedTuple):
    """What a condensed body is made of.

    compliance, vertices, dents  as in `Basis`
    moments           of the hats of the coarse vertices, see `dents.hat_moments`
    corners, weights  [1] (W,3)  vertices of the triangle that a vertex of the fine mesh lies on, and its share of each
    slopes [1/m] (W,3,3)  gradients of these shares along the surface
    young [Pa], retardation [s]  E, tau
    fine [m] (W,3)    vertices of the fine mesh
    true              what is known of the load's own patch
    """

    compliance: np.ndarray
    vertices: np.ndarray
    dents: np.ndarray
    moments: np.ndarray
    corners: np.ndarray
    weights: np.ndarray
    slopes: np.ndarray
    young: float
    retardation: float
    fine: np.ndarray
    true: TruePatch


COMPLIANCE, FREE, NOW, MORE, OWN, PRESS, RADIUS, WIDE, NARROWED, DEEP, NARROW, THIN, CURVED, NEAR, SLIDES = range(15)
"""Numbers that a body keeps: compliance [m/N], s_free and s [m] of the law that was told, the load [N] on the patch
that large displacement adds, compliance [m/N] of the linear body at rest, the normal force [N] on the patch with what
was added, the patch's radius [m], that on the coarse surface, which the dents were found under, whether it is drawn
together near a nodule; then how far [1] it is outside of what the body can tell, 0 within, 1 at twice the limit: deeper
than the organ was pressed, narrower than the touched mesh, on thin or curved ground, too narrow near a nodule, too
heavy for a surface that is free to slide."""
TOTAL, NUMBERS = 18, 19
"""The normal force of the load [N]; how many numbers."""
ROOM, TILT, FIELDS = 3, 4, 5
"""Of the fields of a contact, see `_take`."""
SIDE = slice(15, 18)
"""What holds the patch along the surface [1] (3), see `true_patch.patch_compliance`."""


class CondensedBody:
    """The state of a condensed organ under the contact.

    basis     compliance of the coarse surface
    mesh      the surface that loads and displacements are given on, in the same frame as `basis`
    young     [Pa] > 0, modulus E
    retardation  [s] >= 0, tau
    radius    [m] of the patch that the terminal law is taken over while nothing is loaded
    reach     [m] from the foot point within which all displacements are told, fewer farther off
    poisson   [1] of the organ under the patch; None: the compliance of the widened load is left as it is, as the full
              model of the same coarse surface has it
    sticks    whether the surface under the patch sticks to the finger
    apart     [m] (V,) distance of each vertex of `basis` from a nodule or capsule; None where there is neither
    """

    def __init__(
        self,
        basis: Basis,
        mesh: Mesh,
        young: float,
        retardation: float,
        radius: float,
        reach: float,
        poisson: float | None = None,
        sticks: bool = True,
        apart: np.ndarray | None = None,
    ) -> None:
        coarse = Mesh(basis.vertices, basis.triangles)
        foot, _, triangle, _ = MeshClosestPoint(coarse).find(mesh.vertices)
        self.corners, self.weights = barycentric(coarse, triangle, foot)
        self.basis, self.mesh = basis, mesh
        self._spreader = Spreader(mesh, radius, "biweight")
        self.young, self.retardation = young, retardation
        self._reach, self._told = reaches(mesh.vertices, ranges(mesh.vertices, reach))
        count = len(basis.vertices)
        dents = basis.dents if basis.dents.size else np.zeros((count, 0))
        moments = hat_moments(coarse)
        true = uncorrected(mesh) if poisson is None else true_patch(coarse, mesh, poisson, sticks, apart)
        slopes = weight_slopes(coarse, self.corners)
        self._model = CondensedModel(
            basis.compliance, basis.vertices, dents, moments, self.corners, self.weights, slopes, young, retardation,
            mesh.vertices, true,
        )  # fmt: skip
        self._ground = Ground(coarse.normals, softness(coarse, self._model, self._spreader), dents)
        self._nodes = np.zeros(len(mesh.vertices), dtype=np.int32)
        self._moved = np.zeros((len(mesh.vertices), 3))
        self._field, self._feet = np.zeros((count, 3), dtype=np.float32), np.zeros((1, 3))
        self._rest(np.zeros((FIELDS, count, 3)), np.zeros((3, count), dtype=np.int64), np.zeros(NUMBERS))
        self._kernels()

    def _rest(self, fields: np.ndarray, marks: np.ndarray, numbers: np.ndarray) -> None:
        """The state of a contact without load, in these arrays of zeros."""
        self._fields, self._marks, self._numbers = fields, marks, numbers
        self._curve = np.zeros((2, self._model.dents.shape[1] + 1))
        self.held = self._fields[0]
        """[N] (V,3) loads that the displacement follows, h."""
        self._count = self._touched = 0
        self._foot = self._normal = (0.0, 0.0, 0.0)
        self._patch, self._pull = NO_NODES, NO_VECTORS
        self._slope, self._turning = np.zeros(3), np.zeros((3, 3))

    def another(self, fields: np.ndarray, marks: np.ndarray, numbers: np.ndarray) -> CondensedBody:
        """The same organ under another contact, its state in these arrays (FIELDS,V,3), (3,V) and (NUMBERS,) of zeros;
        see `bodies.condensed_contacts`."""
        other = copy.copy(self)
        other._rest(fields, marks, numbers)
        return other

    def _kernels(self) -> None:
        """What is computed, for arrays as messages hold them."""
        zero, model, fields, numbers = (0.0, 0.0, 0.0), self._model, self._fields, self._numbers
        self._step = entry_point(
            _step, model, NO_NODES, NO_VECTORS, 0.0, zero, 0.0, fields, self._marks, self._curve, numbers, 0
        )
        self._along = entry_point(
            along, self._ground, self._marks[2], 0, fields[2], fields[TILT], zero, 0.0, 0.0, 0.0, self._slope,
            self._turning,
        )  # fmt: skip
        self._displaced = entry_point(
            _displaced, model, self._feet, self._reach, self._told, fields, self._marks, 0, 0, zero, numbers,
            self._field, self._nodes, self._moved,
        )  # fmt: skip

    def step(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float
    ) -> tuple[float, float, float]:
        """One step of dt > 0 [s] under nodal forces [N] (k,3): (c, s_free, s), the next step's compliance [m/N] and
        free indentation [m] under the patch, and the indentation now [m].

        The indentation is the mean of -n.u over the patch, weighted as the force is, so that force times indentation
        is the work done on the body. With dents c is that of the chord to the next step's indentation at the present
        force (at least `LEAST_FORCE`), or that of the tangent there if it is greater, with the s_free that goes with
        it: so force and indentation there are the body's own, and contact that is solved against it settles.
        """
        patch, pull, share = self._pressed(nodes, forces, foot, normal)
        self._count, self._touched = self._step(
            self._model, patch, pull, share, normal, dt, self._fields, self._marks, self._curve, self._numbers,
            self._count,
        )  # fmt: skip
        compliance, free, now = self._numbers[:MORE].tolist()
        return compliance, free, now

    def _pressed(
        self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """The patch, forces that mark it, and whether these are a load."""
        self._foot, self._normal, self._patch, self._pull = foot, normal, nodes, forces
        if len(nodes):
            return nodes, forces, 1.0
        count = self._spreader.spread(foot, normal, (-normal[0], -normal[1], -normal[2]))
        return self._spreader.nodes[:count], self._spreader.forces[:count], 0.0

    def take(self, nodes: np.ndarray, forces: np.ndarray, foot: tuple, normal: tuple, dt: float) -> None:
        """The first part of a step: what the linear body does under this load alone."""
        patch, pull, share = self._pressed(nodes, forces, foot, normal)
        self._count, self._touched = _take(
            self._model, patch, pull, share, normal, dt, self._fields, self._marks, self._numbers, self._count
        )

    def answer(self, dt: float, aside: float = 0.0, others: float = 0.0) -> tuple[float, float, float]:
        """The second part: what other contacts and large displacement add; returns what `step` does.

        aside   [m] indentation of the linear body under the patch by what the other contacts have done
        others  [N] force on the patch that would indent it as what presses there now does
        """
        _answer(self._model, dt, self._fields, self._marks, self._curve, self._numbers, self._touched, aside, others)
        compliance, free, now = self._numbers[:MORE].tolist()
        return compliance, free, now

    @property
    def extrapolation(self) -> float:
        """How far the last step is outside of what the body can tell, 0 within, 1 at twice the limit; `causes` says
        why."""
        return max(self._numbers[DEEP : SLIDES + 1].tolist())

    def causes(self) -> list[str]:
        """Which limits the last step was outside of, see `CAUSES`."""
        excess = self._numbers[DEEP : SLIDES + 1].tolist()
        return [cause for cause, over in zip(CAUSES, excess, strict=True) if over > 0.0]

    def caution(self, cause: str) -> str:
        """What a cause of the last step means, and the error to expect."""
        numbers = self._numbers
        return caution(cause, float(numbers[DEEP + CAUSES.index(cause)]), float(numbers[RADIUS]), float(numbers[WIDE]))

    @property
    def still(self) -> bool:
        """Whether no vertex holds a load any more."""
        return self._count == 0

    def stored(self) -> float:
        """Energy [J] held under the last step's patch at its indentation, V(s) of `physics.bodies.place_energy`; what
        tangential loads and places left behind hold is not in it."""
        now, own = float(self._numbers[NOW]), float(self._numbers[OWN])
        if not (now > 0.0 and own > 0.0):
            return 0.0
        if not self._model.dents.shape[1]:
            return 0.5 * now * now / own
        radius = float(self._numbers[WIDE])
        return float(radius * radius / own * held(self._curve[0], self._curve[1], now / radius))

    def along(self) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """What the energy at the force of the last step gains along the surface [N] (3), and how the normal turns there
        [1/m] (9), row by row: see `physics.bodies.place_energy`."""
        radius, compliance, force = self._numbers[[WIDE, OWN, TOTAL]].tolist()
        self._along(
            self._ground, self._marks[2], self._touched, self._fields[2], self._fields[TILT], self._normal, radius,
            compliance, force, self._slope, self._turning,
        )  # fmt: skip
        x, y, z = self._slope.tolist()
        return (x, y, z), tuple(self._turning.ravel().tolist())

    def displaced(self, foot: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh, all near the foot point and fewer farther off, and their displacements [m] (k,3)."""
        self._feet[0] = foot
        count = self._displaced(
            self._model, self._feet, self._reach, self._told, self._fields, self._marks, self._count, self._touched,
            self._normal, self._numbers, self._field, self._nodes, self._moved,
        )  # fmt: skip
        return self._nodes[:count], self._moved[:count]


@kernel
def _step(model, patch, pull, share, normal, dt, fields, marks, curve, numbers, count):
    """`_take` and `_answer`, of one contact."""
    count, touched = _take(model, patch, pull, share, normal, dt, fields, marks, numbers, count)
    _answer(model, dt, fields, marks, curve, numbers, touched, 0.0, 0.0)
    return count, touched


@kernel
def _take(model, patch, pull, share, normal, dt, fields, marks, numbers, count):
    """`share` is 1 where `pull` is a load, 0 where it only marks the patch. Returns how many vertices hold load, and
    how many the patch touches.

    fields  (F,V,3)    h [N]; the load; shares of the normal force, of the true patch and drawn together; room; what the
                       shares change by as the patch moves [1/m]
    marks   [1] (3,V)  the vertices that hold load; 1 for each of these; the vertices of the patch
    """
    young = model.young
    held, load, measure, tilt = fields[0], fields[1], fields[2], fields[TILT]
    active, marked, order = marks[0], marks[1], marks[2]
    # the load, and the patch weights m, on the vertices of the coarse mesh
    for k in range(count):
        load[active[k]] = 0.0
        measure[active[k], 0] = 0.0
    touched = 0
    total = normal_force(pull, normal)
    for k in range(len(patch)):
        p = patch[k]
        part = share_of(k, pull, normal, total)
        for a in range(3):
            v = model.corners[p, a]
            if marked[v] < 2:  # 1: holds load, 2: touched now
                marked[v] += 2
                order[touched] = v
                touched += 1
                load[v] = 0.0
                measure[v, 0] = 0.0
                tilt[v] = 0.0
            w = model.weights[p, a]
            measure[v, 0] += w * part
            for i in range(3):
                load[v, i] += share * w * pull[k, i]
                tilt[v, i] += part * model.slopes[p, a, i]
    # history h of the load: Kelvin-Voigt retardation over dt
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    for k in range(count):
        for i in range(3):
            held[active[k], i] *= keep
    for k in range(touched):
        v = order[k]
        marked[v] -= 2
        if share > 0.0:
            for i in range(3):
                held[v, i] += take * load[v, i]
            if marked[v] == 0:
                marked[v] = 1
                active[count] = v
                count += 1
    # drop what has faded
    kept = 0
    for k in range(count):
        v = active[k]
        if abs(held[v, 0]) + abs(held[v, 1]) + abs(held[v, 2]) < FORGOTTEN:
            held[v] = 0.0
            marked[v] = 0
        else:
            active[kept] = v
            kept += 1
    count = kept
    # the patch as small as the load is: a half-space's correction to the compliance
    radius, narrow = load_radius(model.fine, patch, pull, normal, total, model.true.least)
    wide = patch_radius(model.vertices, model.moments, order, touched, measure)
    numbers[DEEP : SLIDES + 1] = 0.0
    narrowed = draw_together(model, patch, pull, normal, total, order, touched, measure, radius)
    block = np.zeros((3, 3))
    # indentation of the linear body: m.C h of the history, m.C f of the load
    sums = np.zeros(4)
    for k in range(count):
        _gather(model, active[k], order, touched, measure, held, load, normal, block, sums)
    for k in range(touched):
        if marked[order[k]] == 0:
            _gather(model, order[k], order, touched, measure, held, load, normal, block, sums)
    now, pressed, static, hats = sums
    body, more = patch_compliance(
        model.compliance, model.true, order, touched, measure, narrowed, normal, radius, block, hats, numbers[SIDE]
    )
    numbers[NARROWED] = narrowed
    if len(model.true.table) > 0 and share > 0.0:
        numbers[NARROW] = narrow
        thin, curved = ground_under(model.true.ground, order, touched, measure)
        numbers[THIN] = max(FLAT * radius * thin - 1.0, 0.0)
        numbers[CURVED] = max(FLAT * radius * curved - 1.0, 0.0)
        if not model.true.sticks:
            numbers[SLIDES] = max(total / (young * radius * radius * LIGHT) - 1.0, 0.0)
        numbers[NEAR] = max(NEAR_WIDTH * wide / radius - 1.0, 0.0) if narrowed else 0.0
    self_compliance = (body + more) / young
    press = pressed / body if body > 0.0 else 0.0  # the normal force on the patch that h stands for
    # what the tangential load adds
    tangential = (static - body * total) / young if share > 0.0 and total > 0.0 else 0.0
    now = (now + more * press) / young
    free = keep * now + take * tangential
    numbers[COMPLIANCE], numbers[FREE], numbers[NOW] = take * self_compliance, free, now
    numbers[MORE], numbers[OWN], numbers[PRESS] = 0.0, self_compliance, press
    numbers[RADIUS], numbers[WIDE], numbers[TOTAL] = radius, wide, total * share
    return count, touched


@kernel
def _gather(model, b, order, touched, measure, held, load, normal, block, sums):
    """Add what the coarse vertex b is to the patch: to `block` [m/N] (3,3) its part of g.C g, and to `sums` those of
    m.C h, of the part of it that the normal forces of h make, of m.C f, and of g.T g."""
    first, second, third = model.compliance[3 * b], model.compliance[3 * b + 1], model.compliance[3 * b + 2]
    c00 = c01 = c02 = c10 = c11 = c12 = c20 = c21 = c22 = hats = 0.0
    corrects = len(model.true.table) > 0
    for k in range(touched):
        v = order[k]
        share, at = measure[v, 0], 3 * v
        c00 += share * first[at]
        c01 += share * first[at + 1]
        c02 += share * first[at + 2]
        c10 += share * second[at]
        c11 += share * second[at + 1]
        c12 += share * second[at + 2]
        c20 += share * third[at]
        c21 += share * third[at + 1]
        c22 += share * third[at + 2]
        if corrects:
            hats += share * model.true.table[b, v]
    n0, n1, n2 = normal
    w0, w1, w2 = c00 * n0 + c01 * n1 + c02 * n2, c10 * n0 + c11 * n1 + c12 * n2, c20 * n0 + c21 * n1 + c22 * n2
    sums[0] -= w0 * held[b, 0] + w1 * held[b, 1] + w2 * held[b, 2]
    sums[1] -= (w0 * n0 + w1 * n1 + w2 * n2) * (held[b, 0] * n0 + held[b, 1] * n1 + held[b, 2] * n2)
    sums[2] -= w0 * load[b, 0] + w1 * load[b, 1] + w2 * load[b, 2]
    share = measure[b, 0]
    if share != 0.0:
        for i, row in enumerate(((c00, c01, c02), (c10, c11, c12), (c20, c21, c22))):
            for j in range(3):
                block[i, j] += share * row[j]
        sums[3] += share * hats


@kernel
def _answer(model, dt, fields, marks, curve, numbers, touched, aside, others):
    """Change `numbers` by what other contacts and large displacement add, see `CondensedBody.answer`.

    curve   (2,D+1)    knots and slopes of the indentation over that of the linear body
    """
    dents, measure, order = model.dents, fields[2], marks[2]
    keep, take = model.retardation / (dt + model.retardation), dt / (dt + model.retardation)
    self_compliance = numbers[OWN]
    numbers[FREE] += keep * aside
    numbers[NOW] += aside
    if dents.shape[1] == 0 or not self_compliance > 0.0:
        return
    # large displacement: nonlinear indentation table, s/R over that of the linear body
    radius, now, free = numbers[WIDE], numbers[NOW], numbers[FREE]
    knots, slopes = curve[0], curve[1]
    rise(dents, order, touched, measure, knots, slopes)
    force = max(numbers[TOTAL] + others, LEAST_FORCE)
    numbers[NOW] = radius * risen(now / radius, knots, slopes)[0]
    numbers[FREE] = radius * risen(free / radius, knots, slopes)[0]
    end = SPACING * dents.shape[1]
    numbers[DEEP] = max(numbers[NOW] / (radius * end) - 1.0, 0.0)
    then, slope = risen((free + take * self_compliance * force) / radius, knots, slopes)
    numbers[COMPLIANCE] = (radius * then - numbers[FREE]) / force
    # of a convex s(f): so contact comes to its force from above, and does not swing
    if slope * take * self_compliance > numbers[COMPLIANCE]:
        numbers[COMPLIANCE] = slope * take * self_compliance
        numbers[FREE] = radius * then - numbers[COMPLIANCE] * force
    numbers[MORE] = (numbers[NOW] - now) / self_compliance
    numbers[PRESS] += numbers[MORE]


@kernel
def add_field(model, u, fields, marks, count, touched, normal, numbers):
    """Add displacements u (V,3), in single precision, of the coarse vertices: of the body under what it holds, what
    large displacement adds and what holds the patch along the surface, less the half-space's own under the hats."""
    held, share, room, active, order = fields[0], fields[2], fields[ROOM], marks[0], marks[2]
    true, press, side = model.true, numbers[PRESS], numbers[SIDE]
    narrowed = numbers[NARROWED] > 0.0
    for k in range(touched):
        v = order[k]
        for i in range(3):
            room[v, i] = share[v, 0] * (press * side[i] - numbers[MORE] * normal[i])
            if narrowed:  # twice: what is shown passes through the hats once more
                room[v, i] += 2.0 * (share[v, 1] - share[v, 0]) * press * (side[i] - normal[i])
    for k in range(count):
        b = active[k]
        for i in range(3):
            room[b, i] += held[b, i]
        _add_three(u.reshape(-1), model.compliance, b, room[b], model.young)
    for k in range(touched):
        _add_three(u.reshape(-1), model.compliance, order[k], room[order[k]], model.young)
    if len(true.table) > 0:
        n0, n1, n2 = np.float32(normal[0]), np.float32(normal[1]), np.float32(normal[2])
        hats = np.zeros(len(u), dtype=np.float32)
        for k in range(touched):
            v = order[k]
            part = 2.0 * share[v, 1] - share[v, 0] if narrowed else share[v, 0]
            amount, row = np.float32(true.normal * press * part / model.young), true.table[v]
            for b in range(len(hats)):
                hats[b] += amount * row[b]
        for b in range(len(hats)):
            u[b, 0] += hats[b] * n0
            u[b, 1] += hats[b] * n1
            u[b, 2] += hats[b] * n2


@kernel
def _displaced(model, feet, reach, room, fields, marks, count, touched, normal, numbers, u, nodes, moved):
    """Displacements of the fine mesh near the foot; returns of how many vertices."""
    u[:] = 0.0
    add_field(model, u, fields, marks, count, touched, normal, numbers)
    told = carried(model.corners, model.weights, u, reach, feet, room, nodes, moved)
    add_dent(model, feet[0], normal, numbers, nodes[:told], moved)
    return told


@kernel(error_model="numpy")
def _add_three(field, rows, v, force, young):
    """Add rows 3v, 3v + 1, 3v + 2 times a force (3) over `young` to a field; sets the force to 0."""
    f0, f1, f2 = np.float32(force[0] / young), np.float32(force[1] / young), np.float32(force[2] / young)
    force[:] = 0.0
    if f0 == 0.0 and f1 == 0.0 and f2 == 0.0:
        return
    first, second, third = rows[3 * v], rows[3 * v + 1], rows[3 * v + 2]
    for k in range(len(field)):  # the field is read and written once
        field[k] += f0 * first[k] + f1 * second[k] + f2 * third[k]


@kernel(error_model="numpy")
def add_dent(model, foot, normal, numbers, nodes, moved):
    """Add the half-space's own displacement under the true load to that of the fine vertices `nodes`."""
    true, press, radius = model.true, numbers[PRESS], numbers[RADIUS]
    if len(true.table) == 0:
        return
    deep = (1.0 - true.held) * true.normal * press / (model.young * radius)
    n0, n1, n2, flat = deep * normal[0], deep * normal[1], deep * normal[2], 1.0 / (radius * radius)
    for k in range(len(nodes)):
        p = nodes[k]
        d0, d1, d2 = model.fine[p, 0] - foot[0], model.fine[p, 1] - foot[1], model.fine[p, 2] - foot[2]
        dent = dent_at(true.profile, (d0 * d0 + d1 * d1 + d2 * d2) * flat)
        moved[k, 0] -= dent * n0
        moved[k, 1] -= dent * n1
        moved[k, 2] -= dent * n2
