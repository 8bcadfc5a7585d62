"""Numbers from a file that are used as indices: a wrong one would fail late, or address the end of an array from -1."""

import numpy as np


def check_indices(values: object, count: int, what: str, least: int = 0) -> np.ndarray:
    """The values as int64 indices of an array with `count` entries.

    values  whole numbers of any type and shape
    what    begins the message, such as "a triangle has the vertex"
    least   the lowest valid value; -1 if that marks something else

    ValueError: a fraction, a value that is not finite, below `least`, or not below `count`.
    """
    given = np.asarray(values)
    if given.dtype.kind not in "iuf":
        raise ValueError(f"{what} {given.dtype}, expected whole numbers")
    wrong = ~((given >= least) & (given < count))
    if given.dtype.kind == "f":
        wrong |= given != np.floor(given)
    if wrong.any():
        first = given[wrong].ravel()[0].item()
        allowed = f"{least} to {count - 1}" if count > least else "none"
        raise ValueError(f"{what} {first:g}, expected {allowed}: the file is damaged" if isinstance(first, float) else
                         f"{what} {first}, expected {allowed}: the file is damaged")  # fmt: skip
    return given.astype(np.int64)
