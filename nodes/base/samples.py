"""The time between two samples of a position, for nodes that differentiate it.

While messages are late or lost, a network repeats the last one, and a sender at a divisor repeats a sample. The next
sample then differs by the motion of a longer time than one step. Time and age of a message give the time between the
samples. State of the kernels: `sampled`, an int [ns], -1 before the first sample.
"""

from palpate.compiler.kernel import kernel
from palpate.compiler.records import nth


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
