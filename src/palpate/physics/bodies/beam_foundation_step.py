"""One step of an elastic foundation of beams under all loads, and the law of the next step, see `beam_foundation`."""

import math

from palpate.compiler.dot import dot
from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Indices, Matrix, Record, Vector3
from palpate.physics.bodies.stretch import limit_stretch
from palpate.physics.contact.terminal import LEAST_FORCE, LEAST_FREE, fit_terminal
from palpate.physics.materials.voigt import STRAIN_LIMIT, chain_stress_step

NO_FORCE = 1e-9  # [N] Smaller forces count as zero: their distribution is not significant
LARGEST_FORCE = 1e6  # [N] Limit of the force on a node, so that sums are finite
STILL = 1e-9  # [1] An unloaded beam whose strains are all below this is at rest
MOST_APART = 0.8  # [1] Largest difference of displacement between neighbours, over the length of their edge
MOST_SIDEWAYS = 0.5
"""[1] The same for the part along the surface. A triangle inverts when this part changes by its height; in a
right-angled one that is sqrt(2) times the change along its edges, and the indentation of a round body adds to it."""
LEAST_COMPLIANCE = 1e-9  # [m/N] Lower limit for a patch whose layers are all at their limit; it keeps the law finite


@kernel
def held_force(force: float):
    """A force [N] on a node, limited."""
    return min(max(force, -LARGEST_FORCE), LARGEST_FORCE)


@kernel
def loaded_patch(nodes: Indices, forces: Matrix, normal: Vector3, patch: Record, weight: Array):
    """Fill the patch with the shares of nodes in the normal force of a load. Returns its length; 0 without a normal
    force, with the patch unchanged; -1 for a node that the surface does not have."""
    total = 0.0
    for k in range(nodes.shape[0]):
        if not 0 <= nodes[k] < weight.shape[0]:
            return -1
        total += _push(forces[k], normal)
    if not total > NO_FORCE:
        return 0
    for k in range(nodes.shape[0]):
        weight[nodes[k]] += _push(forces[k], normal)
    count = 0
    for k in range(nodes.shape[0]):
        count = _collect(nodes[k], 1.0 / total, patch, weight, count)
    return count


@kernel
def _push(force: Array, normal: Vector3):
    return -(held_force(force[0]) * normal[0] + held_force(force[1]) * normal[1] + held_force(force[2]) * normal[2])


@kernel
def patch_between(
    last: Record, last_count: int, share: float, nodes: Indices, weights: Array, patch: Record, weight: Array
):
    """Blend the patch of the last load, with the weight `share`, and another one. Returns the length of the result."""
    for k in range(last_count):
        weight[last.nodes[k]] += share * last.shares[k]
    for k in range(nodes.shape[0]):
        weight[nodes[k]] += (1.0 - share) * weights[k]
    count = 0
    for k in range(last_count):
        count = _collect(last.nodes[k], 1.0, patch, weight, count)
    for k in range(nodes.shape[0]):
        count = _collect(nodes[k], 1.0, patch, weight, count)
    return count


@kernel
def _collect(j: int, scale: float, patch: Record, weight: Array, count: int):
    if weight[j] != 0.0:
        patch.nodes[count], patch.shares[count] = j, scale * weight[j]
        weight[j] = 0.0
        count += 1
    return count


@kernel
def add_forces(nodes: Indices, forces: Matrix, normal: Vector3, count: int, moving: Record, rubs: Array):
    """Add a load to the beams' forces, and fill `rubs` [1] (3), its friction over its normal force. Returns the number
    of displaced vertices, and the load's normal force [N]."""
    total = 0.0
    for a in range(3):
        rubs[a] = 0.0
    for k in range(nodes.shape[0]):
        j = nodes[k]
        if moving.place[j] < 0:
            moving.place[j] = count
            moving.nodes[count] = j
            count += 1
        for a in range(3):
            moving.force[j, a] += held_force(forces[k, a])
            rubs[a] += held_force(forces[k, a])
        total += _push(forces[k], normal)
    for a in range(3):
        rubs[a] = rubs[a] / total + normal[a] if total > NO_FORCE else 0.0
    return count, total if total > NO_FORCE else 0.0


@kernel
def foundation_step(dt: float, count: int, beams: Record, moving: Record, contacts: Record):
    """Step the beams under all loads and fit the law on the patch of each contact. Returns the numbers of displaced
    vertices and of beams at a limit."""
    active, place, displacement = moving.nodes, moving.place, moving.displacement
    limited = 0.0
    for k in range(count):
        limited += _beam(active[k], dt, beams, moving)
    for i in range(len(contacts.forces)):
        contacts.rubbed[i] = 0.0
        for j in range(i):
            shared, rubbed = _shared_compliance(i, j, dt, beams, moving, contacts)
            contacts.cross[i, j] = contacts.cross[j, i] = shared
            contacts.rubbed[i] += rubbed
            contacts.rubbed[j] += rubbed
    for i in range(len(contacts.forces)):
        _response(i, dt, beams, moving, contacts)
    kept = 0
    for k in range(count):
        j = active[k]
        moving.force[j, :] = 0.0
        still = displacement[j, 0] == 0.0 and displacement[j, 1] == 0.0 and displacement[j, 2] == 0.0
        if still:
            place[j] = -1
        else:
            active[kept], place[j] = j, kept
            for a in range(3):
                moving.moved[kept, a] = displacement[j, a]
            kept += 1
    return kept, limited


@kernel
def limit_displacement(count: int, beams: Record, moving: Record, skin: Record):
    """Limit the sent displacement: along the surface, then as a whole. Returns the number of limited vertices."""
    moved, sideways, edges, shortest = moving.moved, skin.sideways, skin.edges, skin.shortest
    place, nodes, room = moving.place, moving.nodes, skin.room
    for k in range(count):
        normal = beams.normals[moving.nodes[k]]
        along = dot(moved[k], normal)
        for a in range(3):
            sideways[k, a] = moved[k, a] - along * normal[a]
            moved[k, a] -= sideways[k, a]
    limited = limit_stretch(sideways, count, MOST_SIDEWAYS, shortest, edges, place, nodes, room)
    for k in range(count):
        for a in range(3):
            moved[k, a] += sideways[k, a]
    return max(limited, limit_stretch(moved, count, MOST_APART, shortest, edges, place, nodes, room))


@kernel
def _beam(j: int, dt: float, beams: Record, moving: Record):
    """Step one beam under its force; returns 1 if an element or the shear is at its limit, else 0."""
    force, strains, displacement, normal = moving.force[j], moving.strains[j], moving.displacement[j], beams.normals[j]
    along = dot(force, normal)
    push = max(-along, 0.0)
    loaded = force[0] != 0.0 or force[1] != 0.0 or force[2] != 0.0
    strain = chain_stress_step(strains, beams.moduli, beams.viscosities, beams.shares, push / beams.areas[j], dt)
    most = 0.0
    for a in range(strains.shape[0]):
        most = max(most, strains[a])
    # shear: a Voigt element, by backward Euler
    factor = _shear_factor(force, along, beams.softness / beams.areas[j], beams.length)
    yields, axial, sideways = dt / (dt + beams.lag), dot(displacement, normal), 0.0
    for a in range(3):
        tangent = force[a] - along * normal[a]
        kept = (1.0 - yields) * (displacement[a] - axial * normal[a])
        moved = yields * (factor * beams.softness * tangent / beams.areas[j]) + kept
        displacement[a] = moved - strain * beams.length * normal[a]
        sideways = max(sideways, abs(moved))
    if most < STILL and not loaded and sideways < STILL * beams.length:
        strains[:] = 0.0
        displacement[:] = 0.0
        return 0.0
    return 1.0 if most >= STRAIN_LIMIT or factor < 1.0 else 0.0


@kernel
def _shear_factor(force: Array, along: float, softness: float, length: float):
    """Factor [1] <= 1 on the lateral displacement softness |f_t| [m] that limits the shear."""
    sideways = softness * math.sqrt(max(dot(force, force) - along * along, 0.0))
    limit = STRAIN_LIMIT * length
    return 1.0 if sideways <= limit else limit / sideways


@kernel
def _shared_compliance(i: int, j: int, dt: float, beams: Record, moving: Record, contacts: Record):
    """Compliance c_ij [m/N] >= 0 between the patches of two contacts, and the larger magnitude of m_ij and m_ji of each
    to the friction of the other one, summed over their common beams."""
    n, m, weight = contacts.normals[i], contacts.normals[j], moving.weight
    mine, theirs = contacts.rubs[i], contacts.rubs[j]
    first, second = contacts.which[i], contacts.which[j]
    for k in range(contacts.counts[j]):
        weight[contacts.nodes[second, j, k]] = contacts.shares[second, j, k]
    total = mine_there = theirs_here = 0.0
    for k in range(contacts.counts[i]):
        v = contacts.nodes[first, i, k]
        w = contacts.shares[first, i, k] * weight[v]
        if w == 0.0:
            continue
        area, beam, force = beams.areas[v], beams.normals[v], moving.force[v]
        here, there, along = dot(beam, n), dot(beam, m), dot(force, beam)
        for a in range(len(moving.chain)):
            moving.chain[a] = moving.strains[v, a]
        chain_stress_step(moving.chain, beams.moduli, beams.viscosities, beams.shares, max(-along, 0.0) / area, dt)
        axial = beams.length * _chain_compliance(moving.chain, beams, dt)
        side = _shear_factor(force, along, beams.softness / area, beams.length) * beams.softness * dt / (dt + beams.lag)
        total += w / area * (max(here, 0.0) * max(there, 0.0) * axial + side * (dot(n, m) - here * there))
        stretch = axial - side if along < 0.0 else -side
        theirs_here -= w / area * (stretch * here * dot(beam, theirs) + side * dot(n, theirs))
        mine_there -= w / area * (stretch * there * dot(beam, mine) + side * dot(m, mine))
    for k in range(contacts.counts[j]):
        weight[contacts.nodes[second, j, k]] = 0.0
    return max(total, 0.0), max(abs(theirs_here), abs(mine_there))


@kernel
def _chain_compliance(strains: Array, beams: Record, dt: float):
    """d strain / d stress [1/Pa] of a step that ends at these strains, without the elements at their limit."""
    total = 0.0
    for a in range(beams.moduli.shape[0]):
        if beams.shares[a] > 0.0 and strains[a] < STRAIN_LIMIT:
            total += beams.shares[a] / (beams.moduli[a] + beams.viscosities[a] / dt)
    return total


@kernel
def _response(i: int, dt: float, beams: Record, moving: Record, contacts: Record):
    """Fit the law of the next step, of the same length, at the current forces (K, n, free and current indentation), and
    fill the coupling to the other contacts.

    Friction indents beams that are inclined to the contact, and it grows with the normal force. So the slope of the law
    of a contact that presses is that for forces that grow in proportion, where this is the softer one, `whole`. Without
    it a contact that solves with the law overshoots, and above twice the compliance each step makes the next one worse.
    Where the law is softer than the indentation over the force, it begins before the free indentation, so that it
    passes through the present state. (It began there, predicted too much, and two fingers that rub the same beams took
    turns at the force.)
    """
    normal, which, total = contacts.normals[i], contacts.which[i], contacts.forces[i]
    others = 0.0
    for j in range(len(contacts.forces)):
        others += contacts.cross[i, j] * contacts.forces[j]
    loaded = total > 0.0 or others > 0.0
    free = deep = previous = compliance = whole = 0.0
    length, shares, moduli, viscosities = beams.length, beams.shares, beams.moduli, beams.viscosities
    chain, yields = moving.chain, dt / (dt + beams.lag)
    for k in range(contacts.counts[i]):
        j, w = contacts.nodes[which, i, k], contacts.shares[which, i, k]
        area, beam, strains, force = beams.areas[j], beams.normals[j], moving.strains[j], moving.force[j]
        face = dot(beam, normal)
        displacement = moving.displacement[j]
        previous -= w * dot(displacement, normal)
        remains = w * (1.0 - yields) * (dot(displacement, normal) - dot(displacement, beam) * face)
        # next step of the beam without load, and under its current load (if none, the least force of the law)
        for a in range(len(chain)):
            chain[a] = strains[a]
        free += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, 0.0, dt) - remains
        for a in range(len(chain)):
            chain[a] = strains[a]
        along = dot(force, beam)
        push = max(-along, 0.0) if loaded else max(face, 0.0) * w * LEAST_FORCE
        deep += w * face * length * chain_stress_step(chain, moduli, viscosities, shares, push / area, dt) - remains
        # shear, and the compliance of both
        factor = _shear_factor(force, along, beams.softness / area, length)
        side = factor * yields * w * beams.softness / area * (1.0 - face * face)
        if loaded:
            sheared = factor * yields * w * beams.softness / area * (dot(force, normal) - along * face)
            deep -= sheared
            whole -= sheared
        else:
            deep += w * LEAST_FORCE * side
        compliance += w * side
        for a in range(moduli.shape[0]):
            if shares[a] > 0.0 and chain[a] < STRAIN_LIMIT:
                rate = viscosities[a] / dt
                soft = w * length * shares[a] / (moduli[a] + rate) / area
                compliance += w * soft * face * max(face, 0.0)
                whole += face * soft * push
    # the law at the effective force; below the least force the response is extrapolated to it: along its chord, or
    # where others act on a few of the beams, whose friction and limits are not those of the rest, at the slope
    compliance, lacks = max(compliance, LEAST_COMPLIANCE), 0.0
    if loaded:  # what friction takes from the indentation under the normal forces, and what the slope adds to it
        together = total + others / compliance
        if total < LARGEST_FORCE:
            lacks = max(compliance * together - whole, 0.0) + contacts.rubbed[i] * together
        presses = min(total / LEAST_FORCE, 1.0) if others > 0.0 else 1.0
        compliance = max(compliance, presses * (whole / together)) + contacts.rubbed[i]
    acting = total + others / compliance
    least = max(acting, LEAST_FORCE)
    if loaded and acting < least:
        if others > 0.0:
            free = deep - acting * compliance
            deep = free + least * compliance
        else:
            deep = free + (deep - free) * least / acting
    slope = 1.0 / compliance
    law = contacts.laws[i]
    law[3], law[4] = max(free - min(max(free + least / slope - deep, 0.0), lacks), LEAST_FREE), previous
    law[0], law[1] = fit_terminal(law[3], max(deep, law[3] + least / slope), slope, least)
    for j in range(len(contacts.forces)):
        contacts.coupling[i, j] = 1.0 if i == j else contacts.cross[i, j] / compliance
