"""Faults of a run in virtual time, and a touch that suffers them.

lost      messages of a stream to a reader do not arrive: all of them, at random, in turns, in bursts
late      they arrive some ticks later
copies    they arrive once or twice, each some ticks later
stops     a node does not step, as after SIGSTOP
restarts  a node dies, which its readers learn, and returns without its state
stalls    no node steps, as on a machine that does something else

Each lasts from a time to another one, or whenever the motion of the hand is as in `CAUSES`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from palpate.studies.faults.chain import Chain
from palpate.studies.faults.touch import Felt, feel

KINDS = ("lost", "late", "copies", "stops", "restarts", "stalls")
OF_MESSAGES = ("lost", "late", "copies")

CAUSES: dict[str, Callable[[Felt, float], bool]] = {
    "fast": lambda felt, x: felt.speed > 0.02 + 0.3 * x,
    "approaches": lambda felt, x: felt.approach > 0.02 + 0.2 * x,
    "leaves": lambda felt, x: felt.approach < -0.02 - 0.2 * x,
    "presses": lambda felt, x: felt.force > 0.1 + 3.0 * x,
    "touches lightly": lambda felt, x: 0.0 < felt.force < 0.05 + 1.0 * x,
    "is held": lambda felt, x: felt.hand > 0.1 + 1.5 * x,
}
"""By the state of the last tick, with a threshold by x in 0..1."""


@dataclass
class Fault:
    """What happens to a node or an edge in some ticks.

    kind    one of `KINDS`
    where   the node; for messages the stream
    reader  of the messages; "": all
    when    whether it lasts at a tick; for `stalls` it is asked once and lasts `length` ticks
    fate    the delays [ticks] of the copies of a message of a tick while it lasts
    words   when it lasts
    """

    kind: str
    where: str
    reader: str
    when: Callable[[int, Felt], bool]
    words: str
    fate: Callable[[int], tuple[int, ...]] = lambda tick: ()
    length: int = 0
    lasts: bool = False

    def __str__(self) -> str:
        to = f" -> {self.reader or 'all'}" if self.kind in OF_MESSAGES else ""
        return f"{self.kind} {self.where}{to} {self.words}".replace("  ", " ")


def suffer(
    run: Chain, faults: Sequence[Fault], ticks: int, watch: Callable[[int, Felt], None] = lambda tick, felt: None
) -> Felt:
    """One touch with these faults; `watch` is called before each tick, when it is known which of them last."""

    def each(tick: int, felt: Felt) -> None:
        for fault in faults:
            fault.lasts, before = fault.when(run.tick, felt), fault.lasts
            if fault.lasts and not before and fault.kind == "stalls":
                run.stall(fault.length)
            if fault.kind == "restarts" and fault.lasts != before:
                dead = any(f.lasts for f in faults if f.kind == "restarts" and f.where == fault.where)
                if fault.lasts:
                    run.die(fault.where)
                elif not dead:
                    run.revive(fault.where)
        watch(run.tick, felt)

    def fate(stream: str, reader: str, tick: int) -> tuple[int, ...]:
        for fault in faults:
            if fault.lasts and fault.kind in OF_MESSAGES and fault.where == stream and fault.reader in (reader, ""):
                return fault.fate(tick)
        return (0,)

    for fault in faults:
        fault.lasts = False
    run.fate = fate
    run.halted = lambda node, tick: any(f.lasts and f.kind == "stops" and f.where == node for f in faults)
    try:
        return feel(run, ticks, each)
    finally:
        run.fate, run.halted = None, lambda node, tick: False
