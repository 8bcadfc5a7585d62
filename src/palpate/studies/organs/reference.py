"""The quasi-static force of a depth, by a route that shares neither the search for the foot nor the solution in series.

A body at rest under a force f at a place is indented by s2(f); the fingertip's law gives its compression s1(f). The
force of an approach e is the root of s1(f) + s2(f) = e. s2 is that of the node of the body, in one step of 1e6 s.

At an approach rate up to v a viscous fingertip, f = g(s1) <1 + c s1'>, and a body with the retardation tau, whose law
is that of s2 + tau s2', carry at most the root of s1(f/(1 + c v)) + s2(f) = e + tau v, because the force rises with
each rate and neither exceeds v while the finger approaches.

What ends is the strain of beams, not s2 + tau s2': those at their limit do not move, and those below it resist a rate,
or a patch that reaches them, with the stiffness that they have. So, moving, s2(f) is c f with the compliance c = s2/f
at rest at e. (With the law itself, a patch that slid, or rolled over a rim, 20 mm deep reached the limit of the strain
by its motion alone, and 1e10 N were explained.)

Friction that is held indents inclined parts of a body less, or more; the stiffer answer counts.

A patch that slides at the speed u over a body with a memory of the place meets material that has not yielded, and
indents by s2 times L (`lag`), L being 1 for springs and a rigid body. u is the speed of the finger along the surface,
or that of the patch, up to `EASY` times it: near the middle of a ball the foot leads the finger (`geometry.proxy`).
What friction takes away from the indentation of an inclined part is counted in full, because the displacement by a
force along the surface reaches far beyond the patch: the body indents by s2 with friction, less (1 - L) times s2
without, but by at least `LEFT` L times s2 with friction. A patch that rolls over a rim indents another face, at a rate
that counts as one of approach.

Under two fingers the force of the other one moves the surface, by the displacement of the loaded body where this finger
is. A surface that is lifted by w is reached as by an approach e + w. The force that lifts is at most `ABOVE` x the
force of the other finger, whose surface this one lifts in turn: the fixed point of both (`trace`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from palpate.launch.load.classes import find_class
from palpate.messages import Contact, Friction, Load
from palpate.nodes.base.contacts import press_body
from palpate.nodes.contact import Series
from palpate.nodes.spread import Kernel
from palpate.physics.contact.series import elastic
from palpate.studies.organs.lag import lag_of_beams, lag_of_half_space
from palpate.studies.organs.runs import Traces

LONG = 1e6  # [s] a step after which a body is at rest
FORCES = np.concatenate([np.geomspace(0.03, 60.0, 13), np.geomspace(600.0, 6e5, 4)])
"""[N] at which the indentation of a body is computed; between them it is a power. Beams end at the limit of their
strain, so that a finger that is pushed on compresses only itself."""
LONGEST = 50e-3  # [m] approach up to which forces are known
MOST = 1e30  # [N]
TOUCHING = 1e-6  # [N] of a finger that only marks a place
LAGS = {"BeamBundle": lag_of_beams, "ReducedFE": lag_of_half_space}  # of bodies with a memory of the place
LEFT = 0.5
"""[1] of L x s2 with friction that is left at least: in a ball at 0.4 m/s, 63 % of the radius deep, (1 - L) s2 without
friction exceeds s2 with it, and any force was explained; 14 N acted, where 5 N are at rest."""
NEWTON, CLOSE = 30, 1e-6  # steps at most, and the relative change of a force at which they end


class AtRest:
    """Fingertip and body of a graph at rest.

    nodes  settings of the graph's nodes by name
    body   class of the body
    """

    def __init__(self, nodes: dict[str, dict[str, Any]], body: str) -> None:
        self.spread, self.body = Kernel(**nodes["spread"]), find_class(f"deformation.{body}")(**nodes["tissue"])
        self.pair = find_class(f"deformation.{body}")(**nodes["tissue"])  # the body under two fingers
        self.contact = Series(**{k: v for k, v in (nodes.get("joint") or nodes["contact"]).items() if k != "finger"})
        for node in (self.spread, self.body, self.pair, self.contact):
            node.start()
        kind, first, second, radius, self.damping = map(float, self.contact.own["law"])
        self.retardation = _retardation(nodes["tissue"])
        self._lags = LAGS[body]() if body in LAGS else None
        self.compressions = np.linspace(0.0, LONGEST, 4001)
        rows = [elastic(s, int(kind), first, second, radius) for s in self.compressions]
        self.forces, self.tangents = np.minimum(np.array(rows).T, MOST)

    @property
    def radius(self) -> float:
        """[m] of the patch."""
        return self.spread.radius

    @property
    def remembers(self) -> float:
        """Retardation [s] of a body whose places yield one by one; 0: of springs and a rigid body."""
        return 0.0 if self._lags is None else self.retardation

    def indentation(self, foot: np.ndarray, normal: np.ndarray, force: float, rubs: np.ndarray | None = None) -> float:
        """s2 [m] under a force [N] at a point of the surface [m] (3) along its normal [1] (3), with friction of this
        multiple [1] (3) of it."""
        return float(press_body(self.body, self._load(foot, normal, force, rubs), dt=LONG).previous_indentation)

    def _load(self, foot: np.ndarray, normal: np.ndarray, force: float, rubs: np.ndarray | None = None) -> Load:
        given = Contact(foot=tuple(foot.tolist()), normal=tuple(normal.tolist()), force=force, compression=1e-3,
                        indentation=1e-3, compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
        rubbing = None
        if rubs is not None:
            rubbing = Friction(force=tuple((force * rubs).tolist()), bristle=(0.0, 0.0, 0.0), stick=True)
        return self.spread.step(given, rubbing, dt=LONG)

    def yield_under(
        self, here: tuple[np.ndarray, np.ndarray], there: tuple[np.ndarray, np.ndarray], rubs: np.ndarray
    ) -> np.ndarray:
        """How far [m] (2,F) the surface here yields to `FORCES` there, without and with friction of the multiple `rubs`
        [1] (3) of them; foot [m] (3) and normal [1] (3) of each place."""
        found = []
        for multiple in (None, rubs):
            loads = [(self._load(*here, TOUCHING), self._load(*there, f, multiple)) for f in FORCES.tolist()]
            found.append([float(press_body(self.pair, *each, dt=LONG).laws[0][4]) for each in loads])
        return np.array(found)

    def root(self, compliance: np.ndarray, reach: np.ndarray, faster: float, start: np.ndarray) -> np.ndarray:
        """f [N] (n) with s1(f/faster) + compliance f = reach, from a force below it, by Newton's method: s1 is concave,
        so that no step passes the root."""
        force = np.maximum(start, 1e-3 * FORCES[0])
        for _ in range(NEWTON):
            given = force / faster
            short = reach - np.interp(given, self.forces, self.compressions) - compliance * force
            slope = 1.0 / (faster * np.interp(given, self.forces, self.tangents)) + compliance
            before, force = force, np.maximum(force, force + short / slope)
            if (force - before <= CLOSE * before).all():
                break
        return force

    def lags(self, slide: float) -> float:
        """1 - L [1] at a speed [m/s] along the surface."""
        return 0.0 if self._lags is None else float(np.interp(slide * self.retardation / self.radius, *self._lags))

    def place(self, foot: np.ndarray, normal: np.ndarray, rubs: np.ndarray | None = None) -> Place:
        """The body at a point of the surface [m] (3) along its normal [1] (3), under a force with friction of this
        multiple [1] (3) of it, or without, whichever indents less."""
        free = np.array([self.indentation(foot, normal, f) for f in FORCES.tolist()])
        rubbed = free
        if rubs is not None and rubs @ rubs > 1e-4:
            rubbed = np.minimum(free, [self.indentation(foot, normal, f, rubs) for f in FORCES.tolist()])
        return Place(self, rubbed, free)


class Place:
    """Fingertip and body at rest at one place; indentations [m] under `FORCES`, with friction and `free` of it."""

    def __init__(self, rest: AtRest, indentations: np.ndarray, free: np.ndarray) -> None:
        self.rest = rest
        self._force = np.maximum(rest.forces, 1e-12)
        self._body, self._free = (_between_forces(each, np.log(self._force)) for each in (indentations, free))

    def force(
        self,
        approach: np.ndarray | float,
        rate: np.ndarray | float = 0.0,
        slide: float = 0.0,
        rolls: np.ndarray | float = 0.0,
    ) -> np.ndarray:
        """Largest force [N] at approaches [m] (n), a rate of approach, a speed along the surface and rates [m/s] (n) at
        which a patch rolls over a rim; at none of them that at rest."""
        reach, faster = np.asarray(approach), 1.0 + self.rest.damping * float(np.max(rate))
        moves = self.rest.retardation * float(np.max(rate)) + self.rest.remembers * np.asarray(rolls)
        still = np.where(reach > 0.0, np.interp(reach, self.rest.compressions + self._body, self._force), 0.0)
        known = np.maximum(still, FORCES[0])
        sinks, free = (np.interp(known, self._force, each) for each in (self._body, self._free))
        lags = self.rest.lags(slide)
        compliance = np.maximum(sinks - lags * free, LEFT * (1.0 - lags) * sinks) / known
        return np.where(reach + moves > 0.0, self.rest.root(compliance, reach + moves, faster, still), 0.0)

    def stiffness(self, force: float) -> float:
        """Secant stiffness [N/m] of the body under a force [N]."""
        return force / max(float(np.interp(force, self._force, self._body)), 1e-12)


def _between_forces(indentations: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Indentations [m] (n) at forces of these logarithms [1] (n), from those under `FORCES`."""
    logs, deep = np.log(FORCES), np.log(np.maximum(np.maximum.accumulate(indentations), 1e-12))
    first = (deep[1] - deep[0]) / (logs[1] - logs[0])
    last = (deep[-1] - deep[-2]) / (logs[-1] - logs[-2])
    between = np.interp(at, logs, deep)
    between = np.where(at < logs[0], deep[0] + first * (at - logs[0]), between)
    return np.asarray(np.exp(np.where(at > logs[-1], deep[-1] + last * (at - logs[-1]), between)))


def _retardation(tissue: dict[str, Any]) -> float:
    """[s] of the body; the longest of several layers."""
    return float(tissue.get("retardation", max(tissue.get("relaxations", [0.0]))))


def at_rest(traces: Traces) -> AtRest:
    """Fingertip and body of a batch at rest."""
    return AtRest(traces.nodes, traces.setting.body)
