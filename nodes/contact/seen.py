"""Where each of several fingers is, also while its messages are missing, so that the others keep their forces."""

import math
from typing import Any

from palpate.compiler.records import put, vector
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.samples import sample_of, since
from palpate.nodes.contact.finger import GONE
from palpate.physics.contact.end_rate import advance
from palpate.physics.contact.series import elastic
from palpate.physics.contact.terminal import indentation

SEEN = {
    "approach": (), "separation": (), "gap": (), "foot": (3,), "normal": (3,), "slip": (3,), "tick": int, "time": int,
    "heard": bool, "missing": bool, "compressed": (), "left": (),
}  # fmt: skip
"""Fields of the last `Proximity` of a finger; whether it has sent any, and whether its messages are missing; then the
compression [m] of the fingertip when they ended, and what is left of it [1]."""
AWAY = 0.1  # [m] from the body of a finger that has sent nothing yet, or is lifted off


def begin(seen: Any) -> None:
    """The state before any message."""
    seen["separation"] = seen["gap"] = AWAY
    seen["missing"], seen["time"], seen["tick"] = True, -1, -1


@ieee_kernel
def see(seen, finger, proximity, dt):
    """Keep where a finger is; time [s] since its last sample, 0 if it is not newer, the step `dt` [s] if unknown.

    A finger whose messages are missing stays there, and is lifted off (`lifted`). When they return, it begins at the
    body, with a fingertip that is not compressed, and the approach returns slowly (`finger.regained`).

    seen, finger  `SEEN` and `FINGER`, changed in place
    """
    if not proximity.there:
        if not seen.missing:
            seen.missing, seen.compressed, seen.left = True, finger.compression, 1.0
            put(seen.slip, (0.0, 0.0, 0.0))
        seen.left = max(seen.left - dt / GONE, 0.0)
        seen.tick = seen.time = -1
        return dt
    seen.approach, seen.separation, seen.gap = proximity.approach, proximity.separation, proximity.gap
    put(seen.foot, vector(proximity.foot))
    put(seen.normal, vector(proximity.normal))
    put(seen.slip, vector(proximity.slip))
    seen.tick, seen.time = proximity.tick, proximity.time
    returns, seen.missing, seen.heard = seen.missing and seen.heard, False, True
    if not returns:
        return since(finger, sample_of(proximity), dt)
    depth = seen.approach - seen.separation
    finger.sampled, finger.settled = sample_of(proximity), False
    finger.withheld = max(finger.withheld, depth)  # if the body is missing as well; else it is found again
    finger.depth, finger.rate, finger.compression = depth, 0.0, 0.0
    advance(finger.course, 0.0, dt)
    return dt


@ieee_kernel
def lifted(seen, fingertip, law, others):
    """Approach [m] of a finger whose messages are missing: its fingertip loses its compression within `GONE`.

    It is solved at rest (`joint_steps`): lifted within this time, a viscous fingertip would lose the contact at once.
    So its force falls to zero within `GONE`, on a body that recovers slowly as on springs.

    fingertip   (5) its law and damping, see `physics.contact.series.kernel_form`
    law         K, n, c, s_free, s_prev of the body
    others [N]  effect of the other forces there
    """
    if not seen.left > 0.0:
        return -AWAY
    k, n, c, free, previous = law
    compression = seen.left * seen.compressed
    force, _ = elastic(compression, int(fingertip[0]), fingertip[1], fingertip[2], fingertip[3])
    return compression + indentation(force + max(others, 0.0), math.inf, k, n, c, free, previous)
