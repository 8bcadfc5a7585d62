"""Bodies that take several contacts beside those that take one."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from palpate.messages import Load, Surface
from palpate.nodes.base.node import Node, inputs

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
