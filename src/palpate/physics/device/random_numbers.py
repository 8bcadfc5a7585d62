"""The random numbers of numpy's PCG64 in kernels.

M. E. O'Neill, "PCG: A family of simple fast space-efficient statistically good algorithms for random number
generation", Harvey Mudd College, HMC-CS-2014-0905, 2014: the member XSL RR 128/64.
"""

import numpy as np

from palpate.compiler.kernel import kernel

STATE = np.dtype(("<u8", (4,)))
"""State of a generator: high and low half of its state and of its increment [1]."""
HIGH, LOW = np.uint64(0x2360ED051FC65DA4), np.uint64(0x4385DF649FCCF645)  # of the multiplier
HALF, MASK = np.uint64(32), np.uint64(0xFFFFFFFF)
ROTATION, WORD, SPARE = np.uint64(58), np.uint64(63), np.uint64(11)
UNIT = 1.0 / 9007199254740992.0  # 2^-53


def seed_state(seed: int) -> np.ndarray:
    """The state (4) of `np.random.Generator(np.random.PCG64(seed))`."""
    state = np.random.PCG64(seed).state["state"]
    return np.array([word for name in ("state", "inc") for word in divmod(state[name], 2**64)], np.uint64)


@kernel
def high_product(a, b):
    """The high half of the product of two 64-bit numbers."""
    a1, a0, b1, b0 = a >> HALF, a & MASK, b >> HALF, b & MASK
    middle = a1 * b0 + ((a0 * b0) >> HALF)
    return a1 * b1 + (middle >> HALF) + ((a0 * b1 + (middle & MASK)) >> HALF)


@kernel
def uniform(state):
    """The next number [1] of `Generator.random`, in [0, 1); state as of `seed_state`, changed in place."""
    high = high_product(state[1], LOW) + state[0] * LOW + state[1] * HIGH + state[2]
    low = state[1] * LOW + state[3]
    state[0], state[1] = high + np.uint64(low < state[3]), low
    mixed, turn = state[0] ^ low, state[0] >> ROTATION
    word = (mixed >> turn) | (mixed << ((~turn + np.uint64(1)) & WORD))
    return np.float64(word >> SPARE) * UNIT
