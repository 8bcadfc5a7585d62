"""What one finger of a touch went through, and what its depth, rate and slide explain at each tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from palpate.nodes.collision import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.studies.organs.reference import AtRest, Place
from palpate.studies.organs.runs import Traces

PAST = 60e-3  # [s] of approach and rate that explain a force
SMOOTH = 2e-3  # [s] over which the rate of approach is measured
ABOVE = 1.2  # [1] of the quasi-static force
LEAST_FORCE = 0.1  # [N] below which directions do not matter


@dataclass
class Trace:
    """One finger of one touch: fields (T) and (T,3), and times of the laws."""

    values: dict[str, np.ndarray]
    step: float
    rest: AtRest
    nodes: dict[str, dict[str, Any]]
    closest: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
    places: dict[int, Place] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    def place(self, tick: int) -> Place:
        """Finger and body at rest at the foot of a tick."""
        if tick not in self.places:
            rubs = self["friction.force"][tick] if "friction.force" in self.values else np.zeros(3)
            share = rubs / max(float(self["contact.force"][tick]), LEAST_FORCE)
            self.places[tick] = self.rest.place(self["contact.foot"][tick], self["contact.normal"][tick], share)
        return self.places[tick]

    @cached_property
    def deep(self) -> np.ndarray:
        """The greatest approach [m] of the last `PAST` (T)."""
        return greatest(self["collision.approach"], self.ticks(PAST))

    @cached_property
    def fast(self) -> np.ndarray:
        """The greatest rate of approach [m/s] of the last `PAST` (T), over `SMOOTH`."""
        n, e = self.ticks(SMOOTH), -self["collision.gap"]
        before = np.concatenate([np.repeat(e[:1], n), e])[: len(e)]
        return greatest(np.maximum((e - before) / (n * self.step), 0.0), self.ticks(PAST))

    @cached_property
    def slides(self) -> np.ndarray:
        """The greatest speed [m/s] along the surface of the last `PAST` (T)."""
        v, n = self["finger.velocity"], self["contact.normal"]
        aside = length(v - np.einsum("ti,ti->t", v, n)[:, None] * n)
        return greatest(np.where(self["contact.force"] > 0.0, aside, 0.0), self.ticks(PAST))

    @cached_property
    def static(self) -> np.ndarray:
        """Force [N] (T) that the depth explains at rest: `ABOVE` x that of the series law at the deepest place."""
        return ABOVE * self.place(int(np.argmax(self.deep))).force(self.deep)

    @cached_property
    def explained(self) -> np.ndarray:
        """Force [N] (T) that depth, rate and slide explain; rate and slide are rounded up to one of four."""
        place, total = self.place(int(np.argmax(self.deep))), self.static
        rates, slides = (float(each.max()) * np.array([0.0, 0.25, 0.5, 0.75, 1.0]) for each in (self.fast, self.slides))
        for k in range(5):
            for i in range(5):
                moves = (self.fast > rates[k - 1] if k else True) & (self.slides > slides[i - 1] if i else True)
                if k + i and np.any(moves):
                    total = np.where(moves, ABOVE * place.force(self.deep, rates[k], float(slides[i])), total)
        return total

    def ticks(self, seconds: float) -> int:
        return max(1, round(seconds / self.step))


def length(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def greatest(values: np.ndarray, ticks: int) -> np.ndarray:
    """The greatest value of the last `ticks` values (T)."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(values, ticks, origin=(ticks - 1) // 2, mode="nearest"))


def extent(vectors: np.ndarray, ticks: int) -> np.ndarray:
    """Diagonal (T) of the box around the last `ticks` vectors (T,3)."""
    total = np.zeros(len(vectors))
    for axis in range(3):
        total += (greatest(vectors[:, axis], ticks) + greatest(-vectors[:, axis], ticks)) ** 2
    return np.asarray(np.sqrt(total))


def _surface(traces: Traces) -> MeshClosestPoint:
    """The nearest point of the surface as it is loaded: a coarse mesh is refined."""
    if not traces.setting.count:
        return traces.setting.closest()
    return MeshClosestPoint(Mesh(**traces.nodes["collision"]).mesh())


def traced(traces: Traces, rest: AtRest) -> list[Trace | None]:
    """Each touch of a batch; None: its lane stopped, or a value is not finite."""
    closest, listed = _surface(traces).find, list[Trace | None]()
    for lane, ticks in enumerate(traces.ticks):
        values = {name: column[lane, :ticks] for name, column in traces.values.items()}
        good = lane not in traces.failed and all(np.isfinite(v).all() for v in values.values())
        listed.append(Trace(values, traces.step, rest, traces.nodes, closest) if good else None)
    return listed
