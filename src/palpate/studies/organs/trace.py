"""What one finger of a touch went through, and what its depth, rate and slide, and those of a second finger, explain at
each tick."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from palpate.nodes.collision import Mesh
from palpate.physics.geometry.mesh_closest import MeshClosestPoint
from palpate.physics.geometry.proxy import EASY, FASTEST
from palpate.studies.organs.reference import FORCES, AtRest, Place, at_rest
from palpate.studies.organs.runs import Traces
from palpate.studies.organs.touches import THICKNESS, touched_surface

PAST = 60e-3  # [s] of approach and rate that explain a force
SMOOTH, SUDDEN = 2e-3, 0.5e-3  # [s] over which the rate of approach, and that of the normal, are measured
ABOVE = 1.2  # [1] of the quasi-static force
RECALLS = 2.0  # [1] retardation times for which a former place counts
LEAST_FORCE = 0.1  # [N] below which directions do not matter
PATCH = 8e-3  # [m]
LEAST_CURVATURE = PATCH / 8.0  # [m] R
ON = 2e-5  # [m] from the surface within which the direction from the nearest point is not known
NEXT, TURNED = PATCH / 2.0, 0.3  # [m] of the foot, [rad] of the normal and [1] of friction from one place to the next
LEVELS = np.array([0.0, 0.0625, 0.125, 0.25, 0.5, 0.75, 1.0])  # [1] of the greatest rate
ROUNDS, CLOSE = 12, 1e-5  # of the fixed point of two fingers; [m] change of the lift at which it ends


@dataclass
class Trace:
    """One finger of one touch: fields (T) and (T,3), and times of the laws; `other`: the second finger."""

    values: dict[str, np.ndarray]
    step: float
    rest: AtRest
    nodes: dict[str, dict[str, Any]]
    closest: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]
    places: dict[int, Place] = field(default_factory=dict)
    moved: dict[int, np.ndarray] = field(default_factory=dict)
    met: dict[int, float] = field(default_factory=dict)
    other: Trace | None = None

    def __getitem__(self, name: str) -> np.ndarray:
        return self.values[name]

    @property
    def valid(self) -> float:
        """Largest compression [m] for which the law of the fingertip is valid."""
        thickness = (self.nodes.get("joint") or self.nodes["contact"])["thickness"]
        return float(thickness) if thickness > 0.0 else np.inf

    def place(self, tick: int) -> Place:
        """Finger and body at rest at the foot of a tick."""
        if tick not in self.places:
            foot, normal = self["contact.foot"][tick], self["contact.normal"][tick]
            self.places[tick] = self.rest.place(foot, normal, self.rubs(tick))
        return self.places[tick]

    def rubs(self, tick: int) -> np.ndarray:
        """Friction [1] (3) of a tick over the normal force."""
        rubs = self["friction.force"][tick] if "friction.force" in self.values else np.zeros(3)
        return np.asarray(rubs / max(float(self["contact.force"][tick]), LEAST_FORCE))

    def yields(self, tick: int) -> np.ndarray:
        """How far [m] (2,F) the surface here yields to `FORCES` of the other finger, without and with the friction of
        a tick."""
        assert self.other is not None
        if tick not in self.moved:
            here, there = ((t["contact.foot"][tick], t["contact.normal"][tick]) for t in (self, self.other))
            self.moved[tick] = self.rest.yield_under(here, there, self.other.rubs(tick))
        return self.moved[tick]

    @cached_property
    def most_yields(self) -> np.ndarray:
        """`yields` at the deepest place, and at the largest forces."""
        ticks = {int(np.argmax(self.reach)), *(int(np.argmax(t["contact.force"])) for t in (self, self.other) if t)}
        return np.concatenate([self.yields(k) for k in ticks])

    @cached_property
    def yields_most(self) -> float:
        """Largest displacement [m/N] of the surface here over the force of the other finger."""
        return float((np.abs(self.most_yields) / FORCES).max())

    def yield_at(self, tick: int) -> float:
        """The same [m/N] at the places of a tick."""
        return float((np.abs(self.yields(tick)) / FORCES).max())

    @cached_property
    def carried(self) -> float:
        """Largest motion [1] of the surface here over that of the other finger which presses."""
        if self.other is None:
            return 0.0
        sinks = self.other.place(int(np.argmax(self.other.reach)))
        return min(1.0, float((np.abs(self.most_yields) / [f / sinks.stiffness(f) for f in FORCES]).max()))

    @cached_property
    def raised(self) -> np.ndarray:
        """How far [m] (T) the other finger lifts the surface here: both forces are at most `ABOVE` x those of the fixed
        point."""
        lift = np.zeros(len(self.reach))
        if self.other is None or not self.other["contact.force"].max() > 0.0:
            return lift
        theirs, mine, yours = lift, self.most_yields, self.other.most_yields
        for _ in range(ROUNDS):
            before, lift = lift, lift_distance(mine, self.other.explains(theirs))
            theirs = lift_distance(yours, self.explains(before))
            if np.abs(lift - before).max() < CLOSE:
                break
        return lift

    def most(self, tick: int) -> float:
        """Force [N] that depth, rate and slide of a tick explain at its places, and at those which a body that recalls
        them has just left; `ABOVE` included."""
        if self.other is None or not self.other["contact.force"].max() > 0.0:
            return self._most(tick, 0.0)
        mine, yours, lift, theirs = self.yields(tick), self.other.yields(tick), 0.0, 0.0
        for _ in range(ROUNDS):
            before, lift = lift, float(lift_distance(mine, self.other._most(tick, theirs)))
            theirs = float(lift_distance(yours, self._most(tick, before)))
            if abs(lift - before) < CLOSE:
                break
        return self._most(tick, lift)

    def _most(self, tick: int, lift: float) -> float:
        fast = max(float(self.fast[tick]), self.meets(tick))
        reach, slides, rolls = self.reach[tick] + lift, float(self.slides[tick]), float(self.rolls[tick])
        since = tick - RECALLS * self.rest.remembers / self.step
        places = [tick, *(before for before in self.visited if since <= before < tick)]
        return ABOVE * max(float(self.place(at).force(reach, fast, slides, rolls)) for at in places)

    def meets(self, tick: int) -> float:
        """Rate [m/s] at which the finger approaches the point of the surface that is nearest now: over `SMOOTH`, or by
        its velocity."""
        if tick not in self.met:
            n = min(self.ticks(SMOOTH), tick)
            p, before = self["finger.position"][tick], self["finger.position"][tick - n]
            foot, normal, _, gap = self.closest(p[None])
            away = (p - foot[0]) / gap[0] if abs(gap[0]) > ON else normal[0]
            mean = float((before - p) @ away) / (max(n, 1) * self.step)
            self.met[tick] = max(mean, -float(self["finger.velocity"][tick] @ away), 0.0)
        return self.met[tick]

    @cached_property
    def reach(self) -> np.ndarray:
        """The greatest approach [m] to the undeformed surface in the last `PAST` (T); negative above it."""
        return greatest(THICKNESS - self["collision.gap"], self.ticks(PAST))

    @cached_property
    def deep(self) -> np.ndarray:
        """The greatest approach [m] to the surface, lifted by the other finger, of the last `PAST` (T)."""
        return self.reach + self.raised

    @cached_property
    def fast(self) -> np.ndarray:
        """The greatest rate of approach [m/s] of the last `PAST` (T), over `SMOOTH`, to a surface that the other finger
        moves."""
        theirs = self.carried * self.other.closes if self.other is not None and self.carried > 0.0 else 0.0
        return np.asarray(self.closes + theirs)

    @cached_property
    def closes(self) -> np.ndarray:
        """The greatest rate of approach [m/s] to the undeformed surface."""
        n, e = self.ticks(SMOOTH), -self["collision.gap"]
        before = np.concatenate([np.repeat(e[:1], n), e])[: len(e)]
        return greatest(np.maximum((e - before) / (n * self.step), 0.0), self.ticks(PAST))

    @cached_property
    def slips(self) -> np.ndarray:
        """Speed [m/s] (T) of a finger in contact along the surface."""
        v, n = self["finger.velocity"], self["contact.normal"]
        aside = length(v - np.einsum("ti,ti->t", v, n)[:, None] * n)
        return np.where(self["contact.force"] > 0.0, aside, 0.0)

    @cached_property
    def slides(self) -> np.ndarray:
        """The greatest speed [m/s] along the surface of the last `PAST` (T), of the finger, or of its foot up to `EASY`
        times that or `FASTEST`, at which a foot follows its target under a finger at rest."""
        n, foot = self.ticks(SUDDEN), self["contact.foot"]
        before = np.concatenate([np.repeat(foot[:1], n, axis=0), foot])[: len(foot)]
        most = np.where(self["contact.force"] > 0.0, np.maximum(EASY * self.slips, FASTEST), 0.0)
        leads = np.minimum(length(foot - before) / (n * self.step), most)
        return greatest(np.maximum(self.slips, leads), self.ticks(PAST))

    @cached_property
    def rolls(self) -> np.ndarray:
        """The greatest rate [m/s] (T) of the last `PAST` at which a patch that rolls over a rim indents another face:
        e (omega - u/R), R being the radius of the patch and omega the rate at which the normal turns, at most the speed
        over LEAST_CURVATURE."""
        n, normal, speed = self.ticks(SUDDEN), self["contact.normal"], length(self["finger.velocity"])
        before = np.concatenate([np.repeat(normal[:1], n, axis=0), normal])[: len(normal)]
        omega = np.minimum(length(normal - before) / (n * self.step), greatest(speed, n) / LEAST_CURVATURE)
        deep = np.where(self["contact.force"] > 0.0, np.maximum(THICKNESS - self["collision.gap"], 0.0), 0.0)
        return greatest(deep * np.maximum(omega - self.slips / self.rest.radius, 0.0), self.ticks(PAST))

    @cached_property
    def visited(self) -> list[int]:
        """Ticks in contact, each of which is at another place than the one before: a body is stiffer near its base, at
        an edge and where friction holds it than elsewhere."""
        ticks = np.flatnonzero(self["contact.force"] > 0.0)[:: self.ticks(SUDDEN)]
        if not len(ticks):
            return [int(np.argmax(self.reach))]
        foot, normal = self["contact.foot"][ticks], self["contact.normal"][ticks]
        rubs = np.array([self.rubs(k) for k in ticks.tolist()])
        chosen, at = [0], 0
        while True:
            far = np.maximum(length(foot[at:] - foot[at]) / NEXT, length(normal[at:] - normal[at]) / TURNED)
            leaves = np.flatnonzero(np.maximum(far, length(rubs[at:] - rubs[at]) / TURNED) > 1.0)
            if not len(leaves):
                break
            at += int(leaves[0])
            chosen.append(at)
        return ticks[sorted({*chosen, len(ticks) - 1, int(np.argmax(self.reach[ticks]))})].tolist()

    def at_places(self, value: Callable[[Place, slice], np.ndarray | float]) -> np.ndarray:
        """The greater value (T) of two, at the places visited before and after each tick."""
        ends = [0, *self.visited, len(self.reach) - 1]
        total = np.zeros(len(self.reach))
        for before, tick, after in zip(ends, ends[1:], ends[2:], strict=False):
            span = slice(before, after + 1)
            total[span] = np.maximum(total[span], value(self.place(tick), span))
        return total

    @cached_property
    def static(self) -> np.ndarray:
        """Force [N] (T) that the depth explains at rest: `ABOVE` x that of the series law."""
        return self.at_places(lambda place, span: ABOVE * place.force((self.reach + self.raised)[span]))

    @cached_property
    def explained(self) -> np.ndarray:
        """Force [N] (T) that depth, rate and slide explain; rate and slide are rounded up to one of `LEVELS`."""
        return self.explains(self.raised)

    def explains(self, lift: np.ndarray) -> np.ndarray:
        """`explained` on a surface that is lifted [m] (T)."""
        rates, slides = (float(each.max()) * LEVELS for each in (self.fast, self.slides))
        bins = len(LEVELS) * np.searchsorted(rates[:-1], self.fast) + np.searchsorted(slides[:-1], self.slides)
        reach = self.reach + lift

        def most(place: Place, span: slice) -> np.ndarray:
            total, bin_of = place.force(reach[span]), bins[span]
            for number in np.unique(bin_of[bin_of > 0]).tolist():
                moves, (k, i) = bin_of == number, divmod(number, len(LEVELS))
                rolls = self.rolls[span][moves]
                total[moves] = place.force(reach[span][moves], rates[k], float(slides[i]), rolls)
            return ABOVE * total

        return self.at_places(most)

    def ticks(self, seconds: float) -> int:
        return max(1, round(seconds / self.step))


def lift_distance(yields: np.ndarray, force: np.ndarray | float) -> np.ndarray:
    """How far [m] (...) a force [N] (...) lifts a surface, at most, that yields [m] (n,F) to `FORCES`."""
    return np.interp(force, [0.0, *FORCES], [0.0, *np.maximum(-yields.min(axis=0), 0.0)])


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
    """The nearest point of the surface that the finger touches."""
    if not traces.setting.count:
        return traces.setting.closest()
    return MeshClosestPoint(touched_surface(Mesh(**traces.nodes["collision"])))


def trace_batch(runs: Sequence[Traces]) -> list[list[Trace | None]]:
    """Each touch of a batch, for each finger; None: its lane stopped, or a value is not finite."""
    listed = [_trace_lanes(traces, at_rest(traces)) for traces in runs]
    if len(runs) == 2:
        for one, two in zip(*listed, strict=True):
            if one is not None and two is not None:
                one.other, two.other = two, one
    return listed


def _trace_lanes(traces: Traces, rest: AtRest) -> list[Trace | None]:
    closest, listed = _surface(traces).find, list[Trace | None]()
    for lane, ticks in enumerate(traces.ticks):
        values = {name: column[lane, :ticks] for name, column in traces.values.items()}
        good = lane not in traces.failed and all(np.isfinite(v).all() for v in values.values())
        listed.append(Trace(values, traces.step, rest, traces.nodes, closest) if good else None)
    return listed
