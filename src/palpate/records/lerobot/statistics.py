"""Statistics of the features of a data set, by the definitions of LeRobot: of each episode, and of all frames.

A feature of shape (c,) or (..., c) has statistics of shape (c,): they pool all axes but the last, such as the samples
of a window. `std` is the population's (divided by n), and `count` is the number of frames.
"""

from collections.abc import Mapping

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
NAMES = ("min", "max", "mean", "std", "count", *QUANTILES)
FRAMES = 50_000
"""Largest number of frames from which the quantiles of a whole set are computed."""


def of_episodes(values: np.ndarray) -> dict[str, np.ndarray]:
    """The statistics of each episode, (episodes, c) by name, `count` (episodes, 1).

    values  (episodes, frames, ..., c), finite
    """
    episodes, frames = values.shape[:2]
    flat = values.reshape(episodes, -1, values.shape[-1]).astype(float)
    found = {
        "min": flat.min(axis=1),
        "max": flat.max(axis=1),
        "mean": flat.mean(axis=1),
        "std": flat.std(axis=1),
        "count": np.full((episodes, 1), frames),
    }
    return found | dict(zip(QUANTILES, np.quantile(flat, list(QUANTILES.values()), axis=1), strict=True))


class Totals:
    """Statistics of all frames of a set that grows. They are exact, except the quantiles of more than `FRAMES` frames,
    which are those of evenly spaced frames.

    frames  that the set will have, at most
    """

    def __init__(self, frames: int) -> None:
        self._stride = -(-frames // FRAMES)
        self._seen: dict[str, list[dict[str, np.ndarray]]] = {}
        self._sample: dict[str, list[np.ndarray]] = {}

    def with_more(
        self, values: Mapping[str, np.ndarray], episodes: Mapping[str, Mapping[str, np.ndarray]], begin: int
    ) -> "Totals":
        """The totals with these episodes (episodes, frames, ..., c), whose statistics are known.

        begin  number of frames before them
        """
        more = Totals(1)
        more._stride = self._stride
        for name, given in values.items():
            rows = given.reshape(-1, *given.shape[2:])[-begin % self._stride :: self._stride]
            merged = _merge([*self._seen.get(name, []), _as_one(episodes[name])])
            more._seen[name] = [merged]
            more._sample[name] = [*self._sample.get(name, []), rows.reshape(-1, rows.shape[-1])]
        return more

    def statistics(self) -> dict[str, dict[str, list[float]]]:
        """By feature and name, as plain data."""
        found = {}
        for name, (total,) in self._seen.items():
            sample = np.concatenate(self._sample[name]).astype(float)
            parts = np.quantile(sample, list(QUANTILES.values()), axis=0)
            found[name] = {
                key: value.tolist() for key, value in (total | dict(zip(QUANTILES, parts, strict=True))).items()
            }
        return found


def _as_one(episodes: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The statistics of several episodes together, without the quantiles."""
    return _merge([{key: episodes[key][n] for key in NAMES[:5]} for n in range(len(episodes["count"]))])


def _merge(parts: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Statistics of the union of samples: the mean of the means, and the mean variance plus the variance of the means,
    both weighted by the counts."""
    table = {key: np.array([part[key] for part in parts]) for key in NAMES[:5]}
    weight = table["count"] / table["count"].sum()
    mean = (weight * table["mean"]).sum(axis=0)
    variance = (weight * (table["std"] ** 2 + (table["mean"] - mean) ** 2)).sum(axis=0)
    return {
        "min": table["min"].min(axis=0),
        "max": table["max"].max(axis=0),
        "mean": mean,
        "std": np.sqrt(variance),
        "count": table["count"].sum(axis=0),
    }
