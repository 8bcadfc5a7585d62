"""What the hand lacks of the contact's force: a lower bound, since every other bound is an upper one.

felt     mean over 50 ms of the contact's force, less what of it acts on the hand, <= 5 % of it + 0.05 N + B v + k u,
         while the contact is softer than `SOFT` x the stiffest law that the device renders (`device.rendered`), and was
         in the last 150 ms and for `SPAN` counts of the position, over which the controller measures a slope, no
         generated energy is dissipated, and the force is below the device's limit. B v is the
         damping that compensates the loop's lag, of a finger that moves out at v, and the viscous force of body and
         fingertip at the greatest speed of the last 150 ms, up to 15 %, which ends as steeply as a law; k u the
         stiffness of the contact times the motion of the surface by the change of another finger's force.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from palpate.physics.device.rendered import SPAN, compensation, stiffest
from palpate.studies.organs.score import Score
from palpate.studies.organs.trace import LEAST_FORCE, Trace, greatest, length

MEAN = 50e-3  # [s]
SHARE, SLACK, VISCOUS = 0.05, 0.05, 0.15  # [1], [N], [1]
SOFT, SINCE = 0.5, 3  # [1]; spans for which the contact has been soft


def lacks(trace: Trace, observed: np.ndarray) -> Score:
    """The score, see above; `observed` [J] (T): the energy that the display has absorbed."""
    from scipy.ndimage import uniform_filter1d

    n, node, f = trace.ticks(MEAN), trace.nodes["controller"], trace["contact.force"]
    if len(f) <= n or not f.max() > LEAST_FORCE:
        return Score(0.0, 0.0, 0.0, 0.0)
    given = f[:, None] * trace["contact.normal"] + trace["contact.lateral_force"]
    if "friction.force" in trace.values:
        given = given - trace["friction.force"]
    size = length(given)
    lack = size - np.einsum("ti,ti->t", given, trace["controller.force"]) / np.maximum(size, 1e-12)
    # where the law is soft: fingertip and body in series, each at its stiffest
    lag = (node["delay"] + 0.5) * trace.step
    most = stiffest.py_func(node["mass"], node["drag"], node["resolution"], lag)
    one = np.interp(f, trace.rest.forces, trace.rest.tangents)
    body = 1.5 * trace.at_places(lambda place, _: place.stiffness(max(float(f.max()), LEAST_FORCE)))
    stiffness = one * body / (one + body)
    steep = ~(stiffness < SOFT * most)
    soft = (greatest(steep, SINCE * n) == 0) & _has_moved(trace, steep, SPAN * node["resolution"])
    calm = soft & (greatest(-observed, n) <= 0.0) & (greatest(size, n) < 0.9 * node["limit"])
    calm &= -greatest(-f, n) > LEAST_FORCE
    out = np.maximum(np.einsum("ti,ti->t", trace["finger.velocity"], trace["contact.normal"]), 0.0)
    allowed = SHARE * size + SLACK + compensation.py_func(SOFT * most, lag, node["drag"]) * out
    fast = greatest(length(trace["finger.velocity"]), SINCE * n)
    viscous = (stiffness * trace.rest.retardation + f * trace.rest.damping) * fast
    allowed += np.minimum(viscous, VISCOUS * size)
    if trace.other is not None:
        other = trace.other["contact.force"]
        allowed += stiffness * trace.yields_most * (greatest(other, n) + greatest(-other, n))
    mean, bound = (uniform_filter1d(each, n, origin=(n - 1) // 2) for each in (lack, allowed))
    share = np.where(calm, mean / bound, 0.0)
    k = int(np.argmax(share))
    return Score(max(float(share[k]), 0.0), k * trace.step, float(mean[k]), float(bound[k]))


def _has_moved(trace: Trace, steep: np.ndarray, far: float) -> np.ndarray:
    """Whether the finger has been at depths that differ by `far` [m] since the contact was steep (T)."""
    gap, moved = trace["collision.gap"], np.ones(len(steep), bool)
    last = np.flatnonzero(steep)
    for start, end in pairwise([*last.tolist(), len(steep)] if len(last) else []):
        here = gap[start:end]
        moved[start:end] = np.maximum.accumulate(here) - np.minimum.accumulate(here) >= far
    return moved
