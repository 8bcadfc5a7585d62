"""The motion of a foot that trails its target: see `physics.geometry.proxy` for its laws and its memory."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.records import vector
from palpate.physics.arrays import Record

STOPPED = 1e-9  # [1] Pace of a foot that trails and starts again


@kernel
def stay(memory: Record, gap: float, foot: Record):
    """Copy the last foot into `foot`, with this gap."""
    foot.distance = gap
    for k in range(3):
        foot.point[k], foot.normal[k] = memory.foot[k], memory.normal[k]


@kernel
def _move(share: float, memory: Record, foot: Record):
    """The last foot and its normal, changed by a share of `step` and `turned`, into `foot`."""
    size = 0.0
    for k in range(3):
        foot.point[k] = memory.foot[k] + share * memory.step[k]
        foot.normal[k] = memory.normal[k] + share * memory.turned[k]
        size += foot.normal[k] ** 2
    size = np.sqrt(size)
    for k in range(3):
        foot.normal[k] /= size


@kernel
def keep_step(memory: Record, foot: Record):
    """Keep the way from the last foot to `foot` as a step."""
    for k in range(3):
        memory.step[k] = foot.point[k] - memory.foot[k]
        memory.turned[k] = foot.normal[k] - memory.normal[k]


@kernel
def rest(memory: Record):
    """Forget the last step."""
    memory.drift = 0.0
    for k in range(3):
        memory.step[k] = memory.turned[k] = memory.coast[k] = 0.0


@kernel
def coast(memory: Record):
    """Keep the motion of a foot whose target leaps, as `coast`."""
    for k in range(3):
        memory.coast[k] = memory.step[k]
        memory.step[k] = memory.turned[k] = 0.0


@kernel
def _go_on(fade: float, most: float, memory: Record, foot: Record):
    """Move the foot by `coast`, a share `fade` of what it was and at most `most` [m]."""
    size = 0.0
    for k in range(3):
        memory.coast[k] *= fade
        size += memory.coast[k] ** 2
    size = np.sqrt(size)
    share = min(most / size, 1.0) if size > 0.0 else 0.0
    for k in range(3):
        foot.point[k] += share * memory.coast[k]


@kernel
def _share_on(slower: float, most: float, turn: float, memory: Record, foot: Record):
    """The share of its last step that a foot moves on before it turns round to the target `foot` behind it; -1: that is
    not behind. The step is shorter by `slower` [m] and at most `most` [m], and the normal turns by at most `turn`."""
    along = square = turned = 0.0
    for k in range(3):
        along += (foot.point[k] - memory.foot[k]) * memory.step[k]
        square += memory.step[k] ** 2
        turned += memory.turned[k] ** 2
    if not along < 0.0:
        return -1.0
    length, turned = np.sqrt(square), np.sqrt(turned)
    share = min(max(length - slower, 0.0), most) / length
    return min(share, turn / turned) if turned > 0.0 else share


@kernel
def trail(share: float, fade: float, slower: float, most: float, turn: float, memory: Record, foot: Record):
    """Move the last foot by a share of the way to its target `foot`, and by a share `fade` of `coast`, into `foot`; but
    if the target has leapt back behind it, on along its way, see `_share_on`."""
    x, y, z = vector(foot.point)
    on = _share_on(slower, most, turn, memory, foot) if memory.pace > 0.0 else -1.0
    if on < 0.0:
        keep_step(memory, foot)
    else:
        memory.pace = STOPPED
    _move(share if on < 0.0 else on, memory, foot)
    way = 0.0
    for k in range(3):
        way += (foot.point[k] - memory.foot[k]) ** 2
    _go_on(fade if on < 0.0 else 0.0, max(most - np.sqrt(way), 0.0), memory, foot)
    keep_step(memory, foot)
    a, b, c = x - foot.point[0], y - foot.point[1], z - foot.point[2]
    memory.behind = np.sqrt(a * a + b * b + c * c)


@kernel
def rise(most: float, ramp: float, memory: Record):
    """Change of the gap [m] of a tool that leaves a thin body, beyond that of a foot at rest: at last `most`, of which
    each step adds the share `ramp`."""
    before, memory.rising = memory.rising, min(memory.rising + ramp, 1.0)
    memory.drift *= (1.0 - memory.rising) / (1.0 - before) if before < 1.0 else 0.0
    return memory.drift + memory.rising * most


@kernel
def begin_again(leaps: bool, ramp: float, memory: Record):
    """The share [1] of what the gap might cover in this step while a foot starts; its last rate fades as this grows.
    Both begin again where the target leaps, or becomes that of another face.

    ramp  [1] what the share grows by
    """
    if leaps:
        memory.gains, memory.drift = 0.0, memory.excess
    before, memory.gains = memory.gains, min(memory.gains + ramp, 1.0)
    memory.drift *= (1.0 - memory.gains) / (1.0 - before) if before < 1.0 else 0.0
    return memory.gains


@kernel
def next_pace(leaps: bool, pace: float, behind: float, ramp: float, memory: Record):
    """The pace [1] of a foot in this step, see `proxy.MEMORY`.

    leaps   whether the target leaps: the foot starts again; one that was at its target coasts on
    pace    of the last step
    behind  of the last step [m], over the distance of the target if that leaps: 0 for a foot that was at its target
    ramp    [1] what it grows by
    """
    if leaps:
        if behind == 0.0:
            coast(memory)
        return min(abs(pace) * behind + ramp, 1.0)
    if behind > 0.0:
        return min(pace + ramp, 1.0) if pace > 0.0 else pace
    return -1.0
