"""Computes one recorded touch with several models: differences of force, indentation and shape, and step times."""

import gc
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.engine.health import Histogram
from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.engine.slot import Output
from palpate.launch.load.organ_file import OrganFile
from palpate.messages import Contact, Force, Message, Surface
from palpate.records.changed import change_plan, no_idle, organ_overrides, sources
from palpate.records.player import Player
from palpate.records.reader import Recording
from palpate.records.segment_player import live_player
from palpate.records.stored import RecordingError, last_tick

RECORDED = "recorded"
POINTS = 4000  # of a curve in the picture


class _Differences:
    """Running RMS and peak of differences, and peak of the reference."""

    def __init__(self) -> None:
        self.count, self.squares, self.peak, self.scale = 0, 0.0, 0.0, 0.0

    def add(self, difference: float, reference: float) -> None:
        self.count += 1
        self.squares += difference * difference
        self.peak = max(self.peak, difference)
        self.scale = max(self.scale, reference)

    def report(self) -> dict[str, float]:
        """RMS and peak difference in the quantity's unit, and the peak of the reference."""
        return {"rms": math.sqrt(self.squares / self.count) if self.count else 0.0, "peak": self.peak,
                "reference_peak": self.scale}  # fmt: skip


@dataclass
class Variant:
    """One variant of the touch: its settings, plan and results.

    swapped      nodes that differ from the recording
    force        [N] difference of the controller's force vectors
    indentation  [m] difference of the tissue's indentation under the contact
    shape        [m] difference of the surface displacement: RMS over vertices that move in either, per instant
    step         [s] step times of the swapped nodes; whole: of all nodes together; nodes: of each node
    cpu          [s] processor time of this thread for a step of all nodes together; nodes_cpu: of each node
    notes        lines of its nodes for the user
    curves       rows of time [s], force [N], indentation [m], for the picture
    """

    name: str
    overrides: tuple[str, ...]
    plan: Plan
    swapped: tuple[str, ...]
    force: _Differences = field(default_factory=_Differences)
    indentation: _Differences = field(default_factory=_Differences)
    shape: _Differences = field(default_factory=_Differences)
    whole: Histogram = field(default_factory=Histogram)
    step: Histogram = field(default_factory=Histogram)
    nodes: dict[str, Histogram] = field(default_factory=dict)
    cpu: Histogram = field(default_factory=Histogram)
    nodes_cpu: dict[str, Histogram] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    curves: list[tuple[float, float, float]] = field(default_factory=list)

    def report(self) -> dict[str, Any]:
        return {
            "name": self.name,
            "set": list(self.overrides),
            "swapped": list(self.swapped),
            "force_N": self.force.report(),
            "indentation_m": self.indentation.report(),
            "shape_m": self.shape.report(),
            "step_s": self.step.report(),
            "whole_s": self.whole.report(),
            "whole_cpu_s": self.cpu.report(),
            "notes": self.notes,
        }


def compare(
    recording: Recording,
    variants: Sequence[Sequence[str]],
    *,
    reference: Sequence[str] | None = None,
    organ: OrganFile | None = None,
    show: Callable[[int, int], None] = lambda tick, last: None,
    on_tick: Callable[[Sequence[Player]], None] = lambda players: None,
) -> list[Variant]:
    """Compute the recorded touch once for each variant; returns the reference first, and differences from it.

    variants   overrides of each, as for `palpate run --set`; an empty one is the recorded graph
    reference  overrides of the reference; None: the first of the variants
    organ      mesh file in the place of the recorded organ, of all variants, but not of a given reference
    show       called repeatedly with the tick and the last tick
    on_tick    called at each tick with the players of the returned variants

    RecordingError, GraphError: an override does not fit. NodeError: a node raised.
    """
    # Plan the variants and make their players.
    moved = () if organ is None else tuple(organ_overrides(recording, organ)[0])
    label = () if organ is None else (f"organ={organ.file.name}",)
    wanted = [((*label, *given), (*moved, *given)) for given in variants]
    if reference is not None:
        wanted.insert(0, (tuple(reference), tuple(reference)))
    if not wanted or (reference is None and len(wanted) < 2):
        raise RecordingError("comparing takes two variants, such as --set tissue.use=A --set tissue.use=B")
    original = change_plan(recording)
    computed = [_variant(recording, name, given, original) for name, given in wanted]
    drivers = set(sources(recording, original))
    present = recording.ticks()
    players = []
    for variant in computed:
        running = [name for name in variant.plan.order if name not in drivers]
        no_idle(variant.overrides, variant.plan, running)
        players.append(live_player(recording, variant.plan, running, present, encode=False))
    # Step all variants tick by tick and compare their messages with those of the first.
    last = last_tick(present)
    # The first output of each message type.
    outputs = [{out.kind: out for part in reversed(each.parts) for out in reversed(part.outputs)} for each in players]
    every = max(1, last // POINTS)
    collects = gc.isenabled()
    try:
        for player in players:
            player.start()
        gc.disable()  # collections would add milliseconds to a step
        for tick, payloads in recording.instants(present):
            for variant, player in zip(computed, players, strict=True):
                taken = player.time_step(tick, payloads)
                if taken is not None:
                    variant.whole.add(taken[0])
                    variant.cpu.add(taken[1])
            sent = [[_sent_message(each, kind, tick) for kind in (Force, Contact, Surface)] for each in outputs]
            for variant, messages in zip(computed, sent, strict=True):
                _add_differences(variant, messages, sent[0], tick % every == 0)
            on_tick(players)
            if not tick % 256:
                show(tick, last)
    finally:
        if collects:
            gc.enable()
        for player in players:
            player.stop()
    for variant, player in zip(computed, players, strict=True):
        _collect(variant, player)
    return computed


def _variant(recording: Recording, name: tuple[str, ...], overrides: tuple[str, ...], original: Plan) -> Variant:
    plan = change_plan(recording, overrides)
    nodes = original.graph.nodes
    swapped = tuple(
        name
        for name in plan.order
        if name not in nodes
        or full_name(nodes[name].cls) != full_name(plan.graph.nodes[name].cls)
        or any(nodes[name].settings.get(key, value) != value for key, value in plan.graph.nodes[name].settings.items())
        or nodes[name].every != plan.graph.nodes[name].every
    )
    return Variant(" ".join(name) or RECORDED, overrides, plan, swapped)


def _sent_message(outputs: dict[type[Message], Output], kind: type[Message], tick: int) -> Any:
    message = outputs[kind].last if kind in outputs else None
    return message if message is not None and message.tick == tick else None


def _add_differences(variant: Variant, messages: list[Any], reference: list[Any], draw: bool) -> None:
    """Compare the messages of one tick: Force, Contact and Surface, None if not sent."""
    (force, contact, surface), (other_force, other_contact, other_surface) = messages, reference
    if force is not None and other_force is not None:
        variant.force.add(math.dist(force.force, other_force.force), math.hypot(*other_force.force))
    if contact is not None and other_contact is not None:
        depth = other_contact.indentation
        variant.indentation.add(abs(contact.indentation - depth), depth)
    if surface is not None and other_surface is not None:
        variant.shape.add(*_shapes(surface, other_surface))
    sent = force or contact
    if draw and sent is not None:
        size = math.hypot(*sent.force) if isinstance(sent, Force) else sent.force
        depth = contact.indentation if contact is not None else math.nan
        variant.curves.append((sent.time * 1e-9, size, depth))


def _shapes(a: Surface, b: Surface) -> tuple[float, float]:
    """RMS difference [m] over the vertices that move in either surface, and the largest displacement in `b` [m]."""
    peak = float(np.sqrt((b.displacement**2).sum(1).max())) if len(b.nodes) else 0.0
    if a is b:
        return 0.0, peak
    return apart(a.nodes, a.displacement, b.nodes, b.displacement), peak


def apart(nodes: np.ndarray, rows: np.ndarray, other: np.ndarray, others: np.ndarray) -> float:
    """RMS length of the differences of two sparse fields, over the union of their vertices; missing rows are zero.

    nodes, rows    vertices (k,) and values (k,c) of one field
    other, others  vertices (m,) and values (m,c) of the other, in the same unit
    """
    if np.array_equal(nodes, other):  # the usual case
        difference = rows - others
    else:
        every = np.union1d(nodes, other)
        difference = np.zeros((len(every), rows.shape[1]))
        difference[np.searchsorted(every, nodes)] += rows
        difference[np.searchsorted(every, other)] -= others
    if not len(difference):
        return 0.0
    return float(np.sqrt((difference**2).sum(1).mean()))


def _collect(variant: Variant, player: Player) -> None:
    variant.notes = player.notes()
    variant.nodes = {part.name: part.health.step for part in player.parts}
    variant.nodes_cpu = {part.name: part.cpu for part in player.parts}
    chosen = [p for p in player.parts if p.name in variant.swapped]
    # Without swapped nodes (as recorded), show the time of the body for comparison.
    chosen = chosen or [
        p for p in player.parts if any(k is Surface for k in variant.plan.graph.nodes[p.name].streams.values())
    ]
    for part in chosen:
        times = part.health.step
        variant.step.merge(times)
