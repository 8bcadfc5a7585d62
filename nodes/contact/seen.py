"""Where each of several fingers is, also while its messages are missing, so that the others keep their forces."""

from typing import Any

from palpate.compiler.records import put, vector
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.samples import sample_of, since
from palpate.nodes.contact.finger import GONE

SEEN = {
    "approach": (), "separation": (), "gap": (), "foot": (3,), "normal": (3,), "slip": (3,), "tick": int, "time": int,
    "missing": bool, "speed": (),
}  # fmt: skip
"""Fields of the last `Proximity` of a finger; whether its messages are missing, and the speed [m/s] at which it is
lifted then."""
AWAY = 0.1  # [m] from the body, beyond which a finger is not lifted, and where one is that has sent nothing yet
LEAST = 1e-3  # [m] by which a finger above the undeformed surface, on tissue that others lift, is lifted within `GONE`


def begin(seen: Any) -> None:
    """The state before any message."""
    seen["separation"] = seen["gap"] = AWAY
    seen["missing"], seen["time"], seen["tick"] = True, -1, -1


@ieee_kernel
def see(seen, finger, proximity, dt):
    """Keep where a finger is; time [s] since its last sample, 0 if it is not newer, the step `dt` [s] if unknown.

    A finger whose messages are missing is lifted off the body, straight and at a constant speed, by its depth within
    `GONE`: its force falls to zero, and body and other fingers feel that as if it had been lifted. When messages
    return, it begins there as after an outage of the body: the whole approach returns slowly (`finger.regained`).

    seen, finger  `SEEN` and `FINGER`, changed in place
    """
    if not proximity.there:
        if not seen.missing:
            seen.missing = True
            seen.speed = max(seen.approach - seen.separation, LEAST) / GONE
            put(seen.slip, (0.0, 0.0, 0.0))
        seen.tick = seen.time = -1
        before = seen.approach - seen.separation
        depth = min(before, max(before - seen.speed * dt, -AWAY))
        seen.gap += before - depth
        seen.approach, seen.separation = max(depth, 0.0), max(-depth, 0.0)
        return dt
    seen.approach, seen.separation, seen.gap = proximity.approach, proximity.separation, proximity.gap
    put(seen.foot, vector(proximity.foot))
    put(seen.normal, vector(proximity.normal))
    put(seen.slip, vector(proximity.slip))
    seen.tick, seen.time = proximity.tick, proximity.time
    returns, seen.missing = seen.missing and seen.speed > 0.0, False
    if not returns:
        return since(finger, sample_of(proximity), dt)
    finger.sampled = sample_of(proximity)
    finger.depth, finger.rate, finger.settled = seen.approach - seen.separation, 0.0, False
    return dt
