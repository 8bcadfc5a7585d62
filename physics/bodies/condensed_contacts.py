"""A condensed organ under several contacts: each has a body of its own, and all feel one another.

What contact j has done, its history h_j, indents the patch of contact i by

    a_ij = (g_i.C h_j + H_ij y_j)/E,    H_ij = (1 - nu²)/pi (X_ij - g_i.T g_j) n_i.n_j,    i != j

g shares of the normal force at the coarse vertices, C the compliance for a modulus of 1 Pa, y_j the normal force that
h_j stands for on its own patch. As with a patch's own compliance (`physics.bodies.true_patch`) what the coarse
surface's hats do to both loads is undone with a half-space: T its mean 1/r between hats, X that between the true loads,
X = Y(d/R)/R at the distance d, R² the mean of both patches' R²,

    Y(rho) = integral of (48 J3(x)/x³)² J0(x rho) from 0 on,    Y(0) = I,    Y -> 1/rho + 1/(8 rho³)

The compliance between two patches is c_ij = (g_i.C g_j + H_ij)/E = c_ji (E. Betti 1872), |c_ij| <= sqrt(c_ii c_jj).
What holds a patch along the surface enters its own compliance alone (0.6 % of it at nu = 0.45).

Large displacement follows the whole indentation under a patch, its own and that of the others, and its chord over the
linear body's, tau_i, scales what they add: c_ij sqrt(tau_i tau_j) is symmetric and positive, so that a step of all
contacts together is passive. At one place two contacts are one that bears both forces.

The energy changes along the surface under contact i by its own part (`physics.bodies.place_energy`) and by f_i times
the slope of a_ij, which draws a finger into the dent of another.
"""

from collections.abc import Sequence

import numpy as np

from palpate.physics.bodies.condensed_body import CondensedBody, straight
from palpate.physics.bodies.condensed_field import add_dent, add_field
from palpate.physics.bodies.condensed_step import FIELDS, NUMBERS, OWN, PRESS, RADIUS, TILT, TOTAL
from palpate.physics.bodies.patch import Law, Pressed, ReducedBody, carried
from palpate.physics.bodies.true_patch import dent_depth
from palpate.physics.exact import product
from palpate.physics.kept import kept
from palpate.physics.kernel import kernel

STEP, FARTHEST = 1.0 / 32.0, 6.0
"""[1] Of the table of Y over d/R."""


@kept
def joint_profile() -> np.ndarray:
    """Y at rho = 0, STEP ... FARTHEST: the mean of W (`true_patch.dent_profile`) over a patch whose centre lies rho
    off, by Gauss-Legendre's rule over its radius and the trapezoidal one round it."""
    rho = np.arange(0.0, FARTHEST + 0.5 * STEP, STEP)
    node, weight = np.polynomial.legendre.leggauss(32)
    r = 0.5 * (node + 1.0)
    weight = 0.5 * weight * 6.0 * r * (1.0 - r * r) ** 2
    turn = (np.arange(64) + 0.5) * np.pi / 64
    away = np.sqrt(rho[:, None, None] ** 2 + r[:, None] ** 2 + 2.0 * rho[:, None, None] * r[:, None] * np.cos(turn))
    return product(dent_depth(away).mean(axis=2), weight)


class CondensedContacts(ReducedBody):
    """The state of a condensed organ under several contacts.

    body   of the organ, at rest
    count  of contacts
    """

    def __init__(self, body: CondensedBody, count: int) -> None:
        self._coupling = np.eye(count)
        vertices = len(body.basis.vertices)
        self._profile = joint_profile()
        self._fields = np.zeros((count, FIELDS, vertices, 3))
        self._marks, self._numbers = np.zeros((count, 3, vertices), dtype=np.int64), np.zeros((count, NUMBERS))
        self.contacts = [body.another(*own) for own in zip(self._fields, self._marks, self._numbers, strict=True)]
        self._feet = np.zeros((count, 3))
        self._room = np.zeros((count, 4, vertices))
        self._cross, self._aside, self._slope = np.zeros((count, count)), np.zeros(count), np.zeros((count, 3))
        self._held = np.zeros(count)

    def step(self, loads: Sequence[Pressed], dt: float) -> list[tuple[float, float, float]]:
        """One step under all loads: of each contact what `CondensedBody.step` gives."""
        contacts, model = self.contacts, self.contacts[0]._model
        for contact, load in zip(contacts, loads, strict=True):
            contact.take(*load, dt)
        self._feet[:] = [load[2] for load in loads]
        _pairs(
            model, self._profile, self._fields, self._marks, self._numbers,
            np.array([(c._count, c._touched, 0) for c in contacts]), np.array([load[3] for load in loads]),
            self._feet, self._room, self._cross, self._aside, self._slope,
        )  # fmt: skip
        own, force = np.maximum(self._numbers[:, OWN], 1e-300), self._numbers[:, TOTAL]
        others = product(self._cross, force) / own
        take = dt / (dt + contacts[0].retardation)
        laws = [c.answer(dt, a, o) for c, a, o in zip(contacts, self._aside.tolist(), others.tolist(), strict=True)]
        compliance, free, now = np.array(laws).T
        scale = np.sqrt(np.maximum(compliance, 1e-300) / (take * own))
        joined = take * self._cross * np.outer(scale, scale)
        free += compliance * others - product(joined, force)
        self._coupling = joined / np.maximum(compliance, 1e-300)[:, None]
        np.fill_diagonal(self._coupling, 1.0)
        self._slope *= force[:, None]
        self._held = (1.0 - take) * self._held + take * force
        return list(zip(compliance.tolist(), free.tolist(), now.tolist(), strict=True))

    def step_all(self, loads: Sequence[Pressed], dt: float) -> list[Law]:
        """The law of each contact, see `step`."""
        return [straight(*law) for law in self.step(loads, dt)]

    @property
    def coupling(self) -> np.ndarray:
        """[1] (c,c) O, see `physics.contact.joint`."""
        return self._coupling

    @property
    def extrapolation(self) -> float:
        """The largest of the contacts'."""
        return max(contact.extrapolation for contact in self.contacts)

    @property
    def still(self) -> bool:
        """Whether none holds a load any more."""
        return all(contact.still for contact in self.contacts)

    def causes(self) -> list[str]:
        """Those of all contacts."""
        return list(dict.fromkeys(cause for contact in self.contacts for cause in contact.causes()))

    def caution(self, cause: str) -> str:
        """Of the first contact that it is a cause of."""
        return next(contact for contact in self.contacts if cause in contact.causes()).caution(cause)

    def stored(self) -> float:
        """Energy [J] that is held under the patches: of that at each one's indentation the share that its own force has
        in what presses there. For a linear body that is f.C f/2."""
        own = np.maximum(self._numbers[:, OWN], 1e-300)
        acting = self._held + product(self._cross, self._held) / own
        share = np.divide(self._held, acting, out=np.zeros_like(acting), where=acting > 0.0)
        return float(sum(part * c.stored() for part, c in zip(share.tolist(), self.contacts, strict=True)))

    def along(self, contact: int = 0) -> tuple[tuple[float, float, float], tuple[float, ...]]:
        """As `CondensedBody.along`, for one of the contacts."""
        gradient, shape = self.contacts[contact].along()
        x, y, z = (np.array(gradient) + self._slope[contact]).tolist()
        return (x, y, z), shape

    def displaced(self, *feet: tuple) -> tuple[np.ndarray, np.ndarray]:
        """Vertices of the mesh near the foot points and fewer farther off, and their displacements [m] (k,3)."""
        self._feet[:] = feet
        first, u = self.contacts[0], self.contacts[0]._field
        model = first._model
        u[:] = 0.0
        for c in self.contacts:
            add_field(model, u, c._fields, c._marks, c._count, c._touched, c._normal, c._numbers)
        count = carried(
            model.corners, model.weights, u, first._reach, self._feet, first._told, first._nodes, first._moved
        )
        nodes, moved = first._nodes[:count], first._moved[:count]
        for c, foot in zip(self.contacts, self._feet, strict=True):
            add_dent(model, foot, c._normal, c._numbers, nodes, moved)
        return nodes, moved


@kernel
def _pairs(model, profile, fields, marks, numbers, counts, normals, feet, room, cross, aside, slope):
    """Fill the compliances between patches [m/N] (c,c), the indentation [m] (c) of each by what the others have done,
    and its slope along the surface [1] (c,3); the diagonal of `cross` is 0.

    fields (c,F,V,3), marks (c,3,V), numbers (c,N), counts (c,3): of each contact, see `condensed_step`; the third
                                                        count is filled
    room   (c,4,V) of each contact: vertices that it holds load at or touches, its share there, and room for two more
    """
    aside[:] = 0.0
    slope[:] = 0.0
    for i in range(len(counts)):
        cross[i, i] = 0.0
        for k in range(counts[i, 0]):
            v = marks[i, 0, k]
            room[i, 0, k], room[i, 1, v] = v, 0.0
        many = counts[i, 0]
        for k in range(counts[i, 1]):
            v = marks[i, 2, k]
            room[i, 1, v] = fields[i, 2, v, 0]
            if marks[i, 1, v] == 0:
                room[i, 0, many] = v
                many += 1
        counts[i, 2] = many
    for i in range(len(counts)):
        for j in range(i):
            _pair(i, j, model, profile, fields, marks, numbers, counts, normals, feet, room, cross, aside, slope)


@kernel
def _pair(i, j, model, profile, fields, marks, numbers, counts, normals, feet, room, cross, aside, slope):
    """What two contacts are to each other, see `_pairs`. The compliance is read once, for both ways."""
    true, compliance, young = model.true, model.compliance, model.young
    n, m, f, g = normals[i], normals[j], fields[i, 0], fields[j, 0]
    mine, yours = room[i, 2], room[j, 2]
    for k in range(counts[j, 2]):
        yours[int(room[j, 0, k])] = 0.0
    both = 0.0
    for k in range(counts[i, 2]):
        v = int(room[i, 0, k])
        total = 0.0
        for q in range(counts[j, 2]):
            b = int(room[j, 0, q])
            for x in range(3):
                row = compliance[3 * v + x]
                c0, c1, c2 = row[3 * b], row[3 * b + 1], row[3 * b + 2]
                along = c0 * m[0] + c1 * m[1] + c2 * m[2]
                both += room[i, 1, v] * room[j, 1, b] * n[x] * along
                yours[b] -= f[v, x] * along
                total -= n[x] * (c0 * g[b, 0] + c1 * g[b, 1] + c2 * g[b, 2])
        mine[v] = total
    facing = max(n[0] * m[0] + n[1] * m[1] + n[2] * m[2], 0.0) * true.normal
    mean = change = hats = 0.0
    if len(true.table) > 0:
        hats = _hats(i, j, true.table, marks, counts, room)
        _hats(j, i, true.table, marks, counts, room)
        radius = np.sqrt(0.5 * (numbers[i, RADIUS] ** 2 + numbers[j, RADIUS] ** 2))
        away = 0.0
        for x in range(3):
            away += (feet[i, x] - feet[j, x]) ** 2
        away = np.sqrt(away)
        mean, change = _mean_inverse(profile, away / radius)
        mean, change = mean / radius, change / (radius * radius * max(away, 1e-12))
    both += facing * (mean - hats)
    most = np.sqrt(max(numbers[i, OWN] * numbers[j, OWN], 0.0)) * young
    share = (most / abs(both) if abs(both) > most else 1.0) / young
    cross[i, j] = cross[j, i] = share * both
    for a, b in ((i, j), (j, i)):
        press = numbers[b, PRESS]
        done = facing * (mean - hats) * press
        out = 0.0
        for k in range(counts[a, 1]):
            v = marks[a, 2, k]
            here = room[a, 2, v]
            done += room[a, 1, v] * here
            if len(true.table) > 0:
                here -= facing * room[a, 3, v] * press
            for x in range(3):
                slope[a, x] += share * fields[a, TILT, v, x] * here
        for x in range(3):
            slope[a, x] += share * facing * change * press * (feet[a, x] - feet[b, x])
            out += slope[a, x] * normals[a, x]
        for x in range(3):
            slope[a, x] -= out * normals[a, x]
        aside[a] += share * done


@kernel
def _hats(i, j, table, marks, counts, room):
    """Mean 1/r [1/m] between the hats of two patches; leaves that of each vertex of the first in its room."""
    total = 0.0
    for k in range(counts[i, 1]):
        v = marks[i, 2, k]
        near = 0.0
        for q in range(counts[j, 1]):
            b = marks[j, 2, q]
            near += table[v, b] * room[j, 1, b]
        room[i, 3, v] = near
        total += room[i, 1, v] * near
    return total


@kernel
def _mean_inverse(profile, rho):
    """Y at rho, and its derivative."""
    at = rho / STEP
    k = int(at)
    if k + 1 >= len(profile):
        return (1.0 + 0.125 / (rho * rho)) / rho, -(1.0 + 0.375 / (rho * rho)) / (rho * rho)
    rise = profile[k + 1] - profile[k]
    return profile[k] + (at - k) * rise, rise / STEP
