"""Derivatives of a recorded contact by parameters, by forward sensitivity (docs/equations/sensitivity.md).

The finger's path is the recorded one: what a parameter does to the hand that holds the device is not in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from palpate.engine.faults import choices
from palpate.engine.plan import Plan
from palpate.nodes.collision import Mesh, Nurbs
from palpate.nodes.contact.series import Series
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.nodes.friction import _Sliding
from palpate.nodes.spread import Kernel
from palpate.physics.bodies.condensed_body import CondensedBody
from palpate.physics.contact.terminal import Terminal
from palpate.physics.errors import ArgumentError
from palpate.physics.sensitivity.bodies import CondensedTangent, MassSpringTangent
from palpate.physics.sensitivity.friction import FrictionTangent
from palpate.physics.sensitivity.series import SeriesTangent
from palpate.records.samples import Run, Samples
from palpate.records.stored import RecordingError

FINGER = {
    "exponential": ("finger_stiffness", "finger_hardening", "", "finger_damping"),
    "power": ("finger_power_stiffness", "finger_power_exponent", "", "finger_damping"),
    "hertz": ("finger_hertz_slope", "finger_hertz_hardening", "finger_hertz_radius", "finger_damping"),
}
"""Settings of the contact that each of its laws reads, in the order of `ElasticLaw`, and the damping."""
SPRING = ("stiffness", "exponent", "damping")
CONDENSED = ("young", "retardation")
SHOWN = ("force", "compression", "indentation")


class Derivatives(NamedTuple):
    """Of the contact's force, compression and indentation by one parameter, at the times of the contact's messages."""

    force: Samples
    compression: Samples
    indentation: Samples


class Where(NamedTuple):
    """A parameter: its name as it was given, its unit, and the settings that follow it one to one, (node, setting)."""

    name: str
    unit: str
    settings: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Chain:
    """The nodes between the finger's path and the normal force. ArgumentError: one without derivatives."""

    plan: Plan
    collision: str
    contact: str
    spread: str
    tissue: str
    friction: str | None

    @property
    def names(self) -> list[str]:
        """Of these nodes."""
        return [name for name in (self.collision, self.contact, self.spread, self.tissue, self.friction) if name]

    @classmethod
    def of(cls, plan: Plan) -> Chain:
        nodes = plan.graph.nodes
        contacts = [name for name in plan.order if issubclass(nodes[name].cls, Series)]
        if len(contacts) != 1 or nodes[contacts[0]].cls is not Series:
            found = ", ".join(f"{name} ({nodes[name].use})" for name in contacts) or "none"
            raise ArgumentError(f"sensitivity: found {found}, expected one contact.Series: one finger on one body")
        contact = contacts[0]
        senders = {edge.port: edge.producer for edge in plan.edges[contact]}
        if "body" not in senders:
            raise ArgumentError(f"sensitivity: {contact!r} has no body to press on, expected MassSpring or ReducedFE")
        collision, tissue = senders["proximity"], senders["body"]
        loads = [edge.producer for edge in plan.edges[tissue] if edge.port == "load"]
        spread = loads[0] if len(loads) == 1 else ""
        if not spread or nodes[spread].cls is not Kernel:
            raise ArgumentError(f"sensitivity: {tissue!r} hears {', '.join(loads)}, expected one spread.Kernel")
        friction = next((edge.producer for edge in plan.edges[spread] if edge.port == "friction"), None)
        chain = cls(plan, collision, contact, spread, tissue, friction)
        chain._check()
        return chain

    def _check(self) -> None:
        nodes = self.plan.graph.nodes
        body = nodes[self.tissue]
        model = body.settings.get("model", ReducedFE.model)
        if body.cls is not MassSpring and (body.cls is not ReducedFE or model == "sampled"):
            found = f"{body.use}, model {model}" if body.cls is ReducedFE else body.use
            raise ArgumentError(
                f"sensitivity: {self.tissue!r} is {found}, expected deformation.MassSpring, or deformation.ReducedFE "
                "with model nonlinear or linear; `palpate study` varies any parameter of any body"
            )
        if nodes[self.collision].cls not in (Nurbs, Mesh):
            raise ArgumentError(f"sensitivity: {self.collision!r} is {nodes[self.collision].use}, expected "
                                "collision.Nurbs or collision.Mesh")  # fmt: skip
        friction = nodes[self.friction].cls if self.friction and body.cls is ReducedFE else None
        if friction is not None and not issubclass(friction, _Sliding):
            raise ArgumentError(f"sensitivity: {self.friction!r} is {friction.__name__}, expected a bristle law of "
                                "friction, or none")  # fmt: skip
        slow = [name for name in self.names if nodes[name].every != 1]
        if slow:
            ticks = nodes[slow[0]].every
            raise ArgumentError(f"sensitivity: {slow[0]!r} runs at every {ticks} ticks, expected every tick")

    def known(self) -> dict[str, tuple[str, ...]]:
        """Of each node the settings with derivatives."""
        nodes = self.plan.graph.nodes
        law = nodes[self.contact].settings.get("finger_law", Series.finger_law)
        body = SPRING if nodes[self.tissue].cls is MassSpring else CONDENSED
        return {self.tissue: body, self.contact: tuple(filter(None, FINGER[law])), self.collision: ("thickness",)}

    def check(self, parameters: Sequence[Where]) -> None:
        """ArgumentError: a parameter that this chain has no derivative for; says which it has."""
        known = self.known()
        names = [f"{node}.{key}" for node, keys in known.items() for key in keys]
        path = self.names
        for one in parameters:
            reached = [(node, key) for node, key in one.settings if node in path]
            if not reached:
                where = ", ".join(f"{node}.{key}" for node, key in one.settings) or "no running node"
                raise ArgumentError(
                    f"sensitivity {one.name!r} reaches {where}, not the contact's force along the finger's recorded "
                    f"path. {choices('Parameters', one.name, names)}; `palpate study` varies any other"
                )
            for node, key in reached:
                if key not in known.get(node, ()):
                    raise ArgumentError(
                        f"sensitivity {one.name!r}: no derivative by {node}.{key} "
                        f"({self.plan.graph.nodes[node].use}). {choices('Parameters', one.name, names)}; `palpate "
                        "study` varies any other"
                    )

    def seeds(self, node: str, keys: Sequence[str], parameters: Sequence[Where]) -> np.ndarray:
        """(keys, P) Derivatives of settings by the parameters: 1 or 0."""
        return np.array([[float((node, key) in one.settings) for one in parameters] for key in keys])


def derivatives(run: Run, chain: Chain, parameters: Sequence[Where]) -> dict[str, Derivatives]:
    """Of the contact's numbers by each parameter, by its name. RecordingError: the recording has not all it takes."""
    if run.about.get("clock") != "simulated" or any(run._recording.restarted.values()):
        raise RecordingError(f"{run.path}: sensitivities need a run on simulated time in which no node was restarted")
    streams = chain.names
    lacking = [s for s in streams if s not in run or len(run[s]) != len(run[chain.contact])]
    if lacking or run[chain.contact].tick[0] != 0:
        raise RecordingError(f"{run.path}: sensitivities need every message of {', '.join(streams)}")
    return _carried(run, chain, parameters)


def _carried(run: Run, chain: Chain, parameters: Sequence[Where]) -> dict[str, Derivatives]:
    count = len(parameters)
    proximities, contacts = run[chain.collision].messages, run[chain.contact].messages
    loads, surfaces = run[chain.spread].messages, run[chain.tissue].messages
    node = chain.plan.make(chain.contact)
    assert isinstance(node, Series)
    keys = FINGER[node.finger_law]
    series = SeriesTangent(node._finger(), node.finger_damping, chain.seeds(chain.contact, keys, parameters))
    thick = chain.seeds(chain.collision, ("thickness",), parameters)[0]
    rubbing = None
    made = chain.plan.make(chain.tissue)
    if isinstance(made, MassSpring):
        seeds = chain.seeds(chain.tissue, SPRING, parameters)
        spring = MassSpringTangent(made.stiffness, made.exponent, made.damping, seeds)
    else:
        assert isinstance(made, ReducedFE)
        made.start()
        assert isinstance(made._body, CondensedBody)
        condensed = CondensedTangent(made._body, *chain.seeds(chain.tissue, CONDENSED, parameters))
        if chain.friction is not None:
            sliding = chain.plan.make(chain.friction)
            sliding.start()
            assert isinstance(sliding, _Sliding)
            rubbing, rubs = FrictionTangent(sliding._kernel, count), run[chain.friction].messages
    out = np.zeros((3, len(contacts), count))
    law, dlaw, none, last = None, np.zeros((5, count)), np.zeros(count), None
    before = -round(1e9 / chain.plan.graph.rate)
    for k, (proximity, contact, load, surface) in enumerate(zip(proximities, contacts, loads, surfaces, strict=True)):
        dt, before = (contact.time - before) * 1e-9, contact.time
        approach = thick if proximity.approach > 0.0 else none
        off = proximity.approach - contact.compression - contact.indentation
        if contact.force > 0.0 and abs(off) > 1e-9:
            raise RecordingError(
                f"{run.path}: at {contact.time * 1e-9:.4g} s the contact comes in, expected a finger that starts apart"
            )
        came = contact.force, contact.compression, contact.indentation
        df, dx, ds = series.step(*came, dt, law, dlaw, approach)
        if came == last:  # the same numbers, held while it sleeps
            df, dx, ds = out[:, k - 1]
        out[:, k], last = (df, dx, ds), came
        law = Terminal(
            surface.stiffness, surface.exponent, surface.damping, surface.rest_indentation, surface.previous_indentation
        )
        if isinstance(made, MassSpring):
            dlaw = spring.step(law, contact.force, df, dt)
            continue
        dforces = -np.multiply.outer(np.asarray(contact.normal), df)
        if rubbing is not None:
            dforces = dforces + rubbing.step(rubs[k].bristle, contact.normal, proximity.slip, contact.force, dt, df).T
        dlaw = condensed.step(load, df, dforces, dt)
    time = run[chain.contact].time
    units = [run[chain.contact].columns[name].unit for name in SHOWN]
    found = {}
    for p, one in enumerate(parameters):
        columns = zip(out[:, :, p], SHOWN, units, strict=True)
        found[one.name] = Derivatives(*(
            Samples(column, f"d({chain.contact}.{name})/d({one.name})", per(unit, one.unit), time)
            for column, name, unit in columns
        ))  # fmt: skip
    return found


def per(unit: str, other: str) -> str:
    """The unit of a derivative: N/Pa, N/(N/m^n); by a pure number that of what is differentiated."""
    if other == "1":
        return unit
    return f"{unit}/({other})" if set("/ ") & set(other) else f"{unit}/{other}"
