"""What the fingers on a body feel of other bodies that touch it."""

from palpate.compiler.records import floats, nth
from palpate.nodes.base.kernels import kernel


@kernel
def add_neighbours(body, neighbour, fingers, others, yields, pressing):
    """Fill what the fingers on a body feel of its neighbours, whose loads follow theirs in the same order: X [N] (f),
    y [m/N] (f,f) and f_0 [N] (f) of `physics.contact.organs.backed`."""
    coupling = floats(body.coupling)
    others[:fingers] = 0.0
    yields[:fingers, :fingers] = 0.0
    pressing[:fingers] = 0.0
    for j in range(neighbour.count):
        each = nth(neighbour, j)
        if not each.there:
            continue
        lifts, known = floats(each.yields), min(each.pressing.count, each.yields.shape[0])
        for i in range(fingers):
            others[i] += coupling[i, fingers + j] * each.force
            if i < known:
                pressing[i] = each.pressing.values[i]
                for k in range(min(fingers, known)):
                    yields[i, k] += lifts[i, k]
