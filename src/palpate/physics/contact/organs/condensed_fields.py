"""Displacement of a condensed organ by forces on one candidate of a contact, and what the others see of it
(`between_rows`). law, side  a `between_rows.Law`, and the candidates on this organ."""

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array, Matrix, Record, Tensor, Vector3
from palpate.physics.contact.organs.between import BLOCK


@kernel
def vector3(rows: Matrix, i: int):
    """Row i of an array (n,3)."""
    return rows[i, 0], rows[i, 1], rows[i, 2]


@kernel
def gather_hats(law: Record, side: Record, i: int):
    """Fill row i of `side.coarse`, `side.hats` and `side.few` with the coarse vertices where Q_i is not zero, and Q_i
    there."""
    count, coarse, hats = 0, side.coarse, side.hats
    for at in range(side.begins[i], side.ends[i]):
        v, share = side.vertices[at], side.shares[at]
        for a in range(3):
            weight, c = share * side.weights[v, a], side.corners[v, a]
            if weight == 0.0:
                continue
            if law.hats[c] == 0.0:
                coarse[i, count] = c
                count += 1
            law.hats[c] += weight
    for k in range(count):
        hats[i, k] = law.hats[coarse[i, k]]
        law.hats[coarse[i, k]] = 0.0
    side.few[i] = count


@kernel
def gather_all_hats(law: Record, side: Record):
    """The same for all candidates."""
    for i in range(len(side.few)):
        gather_hats(law, side, i)


@kernel
def field_of(law: Record, side: Record, i: int, e: Vector3, out: Array):
    """Fill `out` [m/N] (3V) with C Q_i' e for a modulus of 1 Pa. Two coarse vertices are added at a time: that reads
    and writes `out` half as often."""
    out[:] = 0.0
    count = side.few[i]
    for k in range(0, count - 1, 2):
        v, w, hat, share = 3 * side.coarse[i, k], 3 * side.coarse[i, k + 1], side.hats[i, k], side.hats[i, k + 1]
        x, y, z, a, b, c = hat * e[0], hat * e[1], hat * e[2], share * e[0], share * e[1], share * e[2]
        one, two, three = law.compliance[v], law.compliance[v + 1], law.compliance[v + 2]
        four, five, six = law.compliance[w], law.compliance[w + 1], law.compliance[w + 2]
        for j in range(len(out)):
            first = ((out[j] + x * one[j]) + y * two[j]) + z * three[j]
            out[j] = ((first + a * four[j]) + b * five[j]) + c * six[j]
    if count % 2 == 1:
        v, hat = 3 * side.coarse[i, count - 1], side.hats[i, count - 1]
        x, y, z = hat * e[0], hat * e[1], hat * e[2]
        one, two, three = law.compliance[v], law.compliance[v + 1], law.compliance[v + 2]
        for j in range(len(out)):
            out[j] = ((out[j] + x * one[j]) + y * two[j]) + z * three[j]


@kernel
def fields_along(law: Record, side: Record, i: int, t: Vector3, s: Vector3, out: Array, other: Array):
    """The same for two directions, with one pass over C."""
    out[:], other[:] = 0.0, 0.0
    for k in range(side.few[i]):
        v, hat = 3 * side.coarse[i, k], side.hats[i, k]
        x, y, z, a, b, c = hat * t[0], hat * t[1], hat * t[2], hat * s[0], hat * s[1], hat * s[2]
        one, two, three = law.compliance[v], law.compliance[v + 1], law.compliance[v + 2]
        for j in range(len(out)):
            out[j] = ((out[j] + x * one[j]) + y * two[j]) + z * three[j]
            other[j] = ((other[j] + a * one[j]) + b * two[j]) + c * three[j]


@kernel
def seen_by(side: Record, j: int, field: Array, near: Array, e: Vector3):
    """e.Q_j times a field (3V), and Q_j times Q_i T [1/m]: one loop over the few coarse vertices."""
    x = y = z = value = 0.0
    for k in range(side.few[j]):
        hat, v = side.hats[j, k], side.coarse[j, k]
        c = 3 * v
        x, y, z = x + hat * field[c], y + hat * field[c + 1], z + hat * field[c + 2]
        value += hat * near[v]
    return x * e[0] + y * e[1] + z * e[2], value


@kernel
def see_fields(law: Record, side: Record, j: int):
    """Fill `seen` with Q_j times each of the fields."""
    one, two, three, seen = law.fields[0], law.fields[1], law.fields[2], law.seen
    seen[:] = 0.0
    for k in range(side.few[j]):
        hat, c = side.hats[j, k], 3 * side.coarse[j, k]
        for x in range(3):
            seen[0, x] += hat * one[c + x]
            seen[1, x] += hat * two[c + x]
            seen[2, x] += hat * three[c + x]


@kernel
def put_column(blocks: Tensor, i: int, scale: float, field: Array):
    """Write `scale` times a field (n) to column i of a table in blocks (b,n,4)."""
    block, lane = blocks[i // BLOCK], i % BLOCK
    for k in range(len(field)):
        block[k, lane] = scale * field[k]
