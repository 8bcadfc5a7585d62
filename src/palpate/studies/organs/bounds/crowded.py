"""Two fingers that press nearly the same place."""

import numpy as np

from palpate.studies.organs.touches import THICKNESS
from palpate.studies.organs.trace import Trace, length


def is_crowded(trace: Trace) -> bool:
    """Whether both fingers press places of one side that are nearer than their soft tissue is thick: real ones keep
    each other apart, which is not modelled."""
    if trace.other is None:
        return False
    here, there = ((t["contact.foot"], t["contact.normal"], t["contact.force"] > 0.0) for t in (trace, trace.other))
    facing = np.einsum("ti,ti->t", here[1], there[1]) > 0.0
    return bool((here[2] & there[2] & facing & (length(here[0] - there[0]) < THICKNESS)).any())
