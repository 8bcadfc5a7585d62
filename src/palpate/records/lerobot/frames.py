"""Frames at the rate of a camera, each with a window of touch samples, from streams of any rate."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from palpate.physics.errors import ArgumentError
from palpate.records.lerobot.features import Feature, Sources, Values

HALF = 5e-10  # [s] half of the resolution of a message's time


@dataclass(frozen=True)
class Frames:
    """The times of frames, and of the samples of each.

    rate   of the frames [Hz]; a whole number, as LeRobot stores it
    touch  rate of the samples [Hz], from `rate`

    A frame has the newest ceil(touch/rate) samples up to its time, so that no sample is left out. If the ratio is not
    whole, some samples are in two frames.
    """

    rate: int
    touch: float

    def __post_init__(self) -> None:
        if isinstance(self.rate, bool) or not isinstance(self.rate, int) or self.rate < 1:
            raise ArgumentError(f"fps: found {self.rate!r}, expected a whole number from 1 [Hz]")
        if not self.rate <= self.touch < math.inf:
            raise ArgumentError(f"touch_rate: found {self.touch!r}, expected a number from fps={self.rate} [Hz]")

    @property
    def window(self) -> int:
        """Number of samples in a frame."""
        return math.ceil(self.touch / self.rate - 1e-9)

    def times(self, begin: float, end: float) -> np.ndarray:
        """Times of the frames [s] (n) between these, the first with a whole window; ArgumentError: none fits."""
        first = begin + (self.window - 1) / self.touch
        count = math.floor((end - first) * self.rate + 1e-6) + 1
        if count < 1:
            raise ArgumentError(
                f"touch: found {max(end - begin, 0.0):.3g} s of messages, expected at least {first - begin:.3g} s, "
                f"which are {self.window} samples at {self.touch:g} Hz"
            )
        return first + np.arange(count) / self.rate

    def samples(self, times: np.ndarray) -> np.ndarray:
        """Times of the samples [s] (n, window) of frames; the last one is that of the frame."""
        return times[:, None] - np.arange(self.window - 1, -1, -1) / self.touch


def held_rows(time: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The rows of the newest messages at these times [s]; `time`: of the messages [s] (n), rising."""
    return np.searchsorted(time, wanted + HALF, side="right") - 1


def features_of(sources: Sources, frames: Frames, values: Values) -> dict[str, Feature]:
    """All features of a set. `values` have the number of taxels."""
    found = sources.vectors()
    for window in sources.windows:
        shape = window.of([values[field][:1, :1] for field in window.fields]).shape
        found[window.key] = Feature((frames.window, *shape[2:]), window.names, window.units)
    return found


def sample_frames(
    sources: Sources,
    frames: Frames,
    times: np.ndarray,
    values: Values,
    clocks: Mapping[str, np.ndarray],
    targets: Sequence[np.ndarray | None],
) -> dict[str, np.ndarray]:
    """The features of episodes, float32 (episodes, frames, ...).

    times    of the frames [s] (n)
    values   fields of streams (episodes, rows, ...), whose rows have the times `clocks` [s] (rows) by stream
    targets  of each pose: commanded positions [m] (episodes, frames, 3); None: unknown, and the action is the finger's
             position in the next frame, or in the last one its position there
    """
    at = {stream: held_rows(clocks[stream], times) for stream in sources.poses}
    places = [values[pose, "position"][:, at[pose]] for pose in sources.poses]
    state = [part for pose, place in zip(sources.poses, places, strict=True)
             for part in (place, values[pose, "velocity"][:, at[pose]])]  # fmt: skip
    action = [np.concatenate([place[:, 1:], place[:, -1:]], axis=1) if target is None else target
              for place, target in zip(places, targets, strict=True)]  # fmt: skip
    found = {"observation.state": np.concatenate(state, axis=-1), "action": np.concatenate(action, axis=-1)}
    moments = frames.samples(times)
    for window in sources.windows:
        parts = [values[field][:, held_rows(clocks[field[0]], moments.ravel())] for field in window.fields]
        made = window.of(parts)
        found[window.key] = made.reshape(len(made), *moments.shape, *made.shape[2:])
    return {name: value.astype(np.float32) for name, value in found.items()}
