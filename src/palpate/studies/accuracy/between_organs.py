"""Computes the test case of two organs with the nodes of a graph, see `studies.meeting.reduced`."""

import numpy as np

from palpate.nodes.base import Node, SettingError
from palpate.studies.accuracy import UnsupportedError
from palpate.studies.accuracy.cases import BenchCase
from palpate.studies.accuracy.chain import VERTICES, held_bytes
from palpate.studies.accuracy.outcome import Fidelity, MethodOutcome
from palpate.studies.meeting import reduced
from palpate.studies.meeting.solids import MEETINGS


def run(touch: BenchCase, cls: type[Node], fidelity: Fidelity, repeats: int) -> MethodOutcome:
    """Compute the test case with two bodies of a class; the step is that of contact and both bodies.

    UnsupportedError: the bodies cannot touch each other, or a setting of the finger. ArithmeticError: the force is not
    finite.
    """
    given = fidelity.settings
    if finger := sorted(set(given) - {"body", "surface"}):
        raise UnsupportedError(f"organs that touch have no {finger[0]}")
    times = np.arange(round(touch.duration * fidelity.rate) + 1) / fidelity.rate
    closings, vertices = touch.at(times)[0], given.get("surface", {}).get("vertices", VERTICES)
    assert isinstance(vertices, int)
    try:
        found = reduced.run(MEETINGS[touch.meeting], cls, given["body"], closings, fidelity.rate, repeats, vertices)
    except SettingError as error:
        raise UnsupportedError(str(error)) from None
    if not np.isfinite(found.force).all():
        raise ArithmeticError("the force is not finite")
    values = {"force": found.force, "area": found.area}
    return MethodOutcome(times, values, [], found.seconds, held_bytes(found.nodes), found.offline)
