"""Bodies that take several contacts beside those that take one."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.messages import Load, Surface
from palpate.nodes.base.compiled import TABLE, CompiledNode
from palpate.nodes.base.node import Node, inputs
from palpate.physics.kernel import kernel
from palpate.physics.records import floats, lend

SEVERAL = {"laws": TABLE, "slopes": TABLE, "coupling": TABLE}
"""What a body says of each of several contacts: see the fields of `Surface`."""


def make_room(body: CompiledNode, count: int) -> None:
    """Make room for so many contacts, which are nothing to each other."""
    body.hold("laws", np.zeros((count, 5)))
    body.hold("slopes", np.zeros((count, 12)))
    body.hold("coupling", np.eye(count))


@kernel
def send_laws(own, out):
    """Send what is known of each contact where there are several; the first one's law."""
    law = floats(own.laws)[0]
    out.stiffness, out.exponent, out.damping = law[0], law[1], law[2]
    out.rest_indentation, out.previous_indentation = law[3], law[4]
    if own.laws.shape[0] > 1:
        lend(out.laws, own.laws)
        lend(out.slopes, own.slopes)
        lend(out.coupling, own.coupling)


Slopes = Sequence[tuple[tuple[float, ...], tuple[float, ...]]]


def several(laws: Sequence[tuple[float, ...]], coupling: ArrayLike, slopes: Slopes = ()) -> dict[str, Any]:
    """The fields of `Surface` for several contacts; none for one, whose message stays as it is.

    laws      K, n, c, s_free and s_prev of each
    coupling  [1] (c,c) O
    slopes    tangential gradient [N] (3) and shape operator [1/m] (9) of each; none where the body does not know
    """
    if len(laws) == 1:
        return {}
    rows = np.zeros((len(laws), 12))
    for row, (gradient, shape) in zip(rows, slopes, strict=False):
        row[: 3 + len(shape)] = *gradient, *shape
    return {"laws": np.array(laws), "coupling": np.asarray(coupling), "slopes": rows}


def press(body: Node, *loads: Load, dt: float) -> Surface:
    """A step of any body, called from code of one's own: most take several loads."""
    return body.step([*loads] if inputs(type(body))[0].many else loads[0], dt=dt)
