"""The order of points along a Morton curve, which keeps neighbours in space together, by a radix sort.

The sort is stable and takes a third of the time of `np.argsort(kind="stable")`, with the same result.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Indices, Matrix

BITS, DIGIT = 21, 11  # of each coordinate in a code, and of each pass of the sort


def morton_order(points: np.ndarray) -> np.ndarray:
    """The order (n) of points (n,3) along a Morton curve through the smallest cube round them."""
    codes = np.empty(len(points), np.int64)
    _fill_codes(np.ascontiguousarray(points, dtype=float), codes)
    return order_of(codes)


def order_of(keys: np.ndarray) -> np.ndarray:
    """The order (n) in which finite numbers or integers (n) ascend; equal ones keep theirs."""
    if keys.dtype.kind == "f":
        bits = (keys.astype(np.float64) + 0.0).view(np.int64)  # -0.0 becomes 0.0
        keys = bits ^ (bits >> 63 & np.iinfo(np.int64).max)  # integers in the order of the numbers
    work = np.empty((2, 2, len(keys)), np.int64)
    _sort(np.ascontiguousarray(keys, np.int64), work, np.empty(1 << DIGIT, np.int64))
    return work[0, 1]


@kernel
def _fill_codes(points: Matrix, codes: Indices):
    """Fill in the Morton codes: interleaved bits of the coordinates, `BITS` of each."""
    low, size = np.zeros(3), 1e-300
    for i in range(3):
        least, most = np.inf, -np.inf
        for k in range(len(points)):
            least, most = min(least, points[k, i]), max(most, points[k, i])
        low[i], size = least, max(size, most - least)
    for k in range(len(points)):
        codes[k] = 0
        for i in range(3):
            codes[k] |= _spread(int(min((points[k, i] - low[i]) / size, 1.0) * ((1 << BITS) - 1.0))) << i


@kernel
def _spread(place: int):
    """A number of `BITS` bits with two zeros between its bits."""
    place = (place | place << 32) & 0x1F00000000FFFF
    place = (place | place << 16) & 0x1F0000FF0000FF
    place = (place | place << 8) & 0x100F00F00F00F00F
    place = (place | place << 4) & 0x10C30C30C30C30C3
    return (place | place << 2) & 0x1249249249249249


@kernel
def _sort(keys: Indices, work: Indices, count: Indices):
    """Fill in the keys in ascending order, and the order, work[0]; an even number of passes, from the lowest digit."""
    size, digits = len(keys), len(count)
    for k in range(size):
        work[0, 0, k], work[0, 1, k] = keys[k], k
    for turn in range(6):
        old, new = work[turn % 2], work[1 - turn % 2]
        shift, sign = DIGIT * turn, 256 if turn == 5 else 0  # the sign is in the highest digit
        count[:] = 0
        for k in range(size):
            count[((old[0, k] >> shift) + sign) & (digits - 1)] += 1
        total = 0
        for digit in range(digits):
            count[digit], total = total, total + count[digit]
        for k in range(size):
            digit = ((old[0, k] >> shift) + sign) & (digits - 1)
            new[0, count[digit]], new[1, count[digit]] = old[0, k], old[1, k]
            count[digit] += 1
