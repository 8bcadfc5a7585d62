"""The time between two samples of a position, for nodes that differentiate it.

While messages are late or lost, a network repeats the last one, and a sender at a divisor repeats a sample. The next
sample then differs by the motion of a longer time than one step. Time and age of a message give the time between the
samples. State of the kernels: `sampled`, an int [ns], -1 before the first sample. `slid` has the state `SLID`.
"""

from palpate.compiler.records import nth, put, vector
from palpate.nodes.base.kernels import ieee_kernel, kernel

GAP = 1.5  # [1] a sample that follows the last one after more steps than this ends a gap
SLID = {"sampled": int, "at": (3,)}  # [ns]; [m] position of the finger at the last sample


@kernel
def sample_of(message):
    """Time [ns] of the sample of a message's record; -1: unknown."""
    return max(message.time - message.delayed, 0) if message.time >= 0 else -1


@kernel
def oldest(messages):
    """Age [ns] of the oldest of several messages of one input."""
    age = 0
    for i in range(messages.count):
        age = max(age, nth(messages, i).delayed)
    return age


@kernel
def since(state, sample, dt):
    """Time [s] from the last sample to this one, of the time `sample` [ns]: 0 if it is not newer, the step `dt` if
    unknown."""
    before = state.sampled
    if sample < 0 or before < 0:
        state.sampled = sample
        return dt
    state.sampled = max(sample, before)
    return (state.sampled - before) * 1e-9


@ieee_kernel
def slid(state, proximity, dt):
    """Time [s] from the last sample of the finger's position to this one, 0 if it is not newer, and the velocity [m/s]
    (3) along the surface in that time.

    Without a gap this is the slip velocity, which the kinematics measures over the last step. After a gap it is the
    mean velocity over the gap, so that its product with the time is the displacement of the finger.
    """
    foot, normal, slip = vector(proximity.foot), vector(proximity.normal), vector(proximity.slip)
    known, last, gap = state.sampled >= 0, vector(state.at), proximity.gap
    moved = since(state, sample_of(proximity), dt)
    if moved == 0.0:
        return 0.0, slip
    at = foot[0] + gap * normal[0], foot[1] + gap * normal[1], foot[2] + gap * normal[2]
    put(state.at, at)
    if not known or moved <= GAP * dt:
        return dt, slip
    x, y, z = (at[0] - last[0]) / moved, (at[1] - last[1]) / moved, (at[2] - last[2]) / moved
    away = x * normal[0] + y * normal[1] + z * normal[2]
    return moved, (x - away * normal[0], y - away * normal[1], z - away * normal[2])
