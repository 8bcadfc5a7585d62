"""The description of a tick for programs outside of Python: where the messages and their fields are, in JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from palpate.engine.segment import CompiledSegment, record_of
from palpate.engine.slot import Slot
from palpate.engine.table import CLOCK, FAULT, INFINITE, OUTPUT, RAISED
from palpate.engine.wire_plan import wire_plan
from palpate.messages import Message, fields
from palpate.messages.fields import Field
from palpate.messages.record import address_of, layout
from palpate.web.device import describe_device
from palpate.web.started import Started

WHY = {RAISED: "its kernel failed", FAULT: "it refused its inputs", INFINITE: "a number is not finite"}
ARRAYS = {"<f8": "reals", "<i4": "integers4"}
LONGEST = 4096  # [bytes] of an encoded message of the host


class Hosts:
    """The messages that the host writes, of pointers and devices: arrays that belong to the memory, and their
    description."""

    def __init__(self, run: Started) -> None:
        self._run = run
        hosts = [*run.pointers, *run.devices]
        self._plans = {slot.name: wire_plan(slot.outputs[0].kind, slot.name) for slot in hosts}
        self._buffer = np.zeros(LONGEST, np.uint8)
        self.arrays = [array for each in self._plans.values() for array in (each.steps, each.literals)] + [self._buffer]

    def describe(self, address: Callable[[int], int]) -> dict[str, Any]:
        run = self._run
        pointers = [
            {**self._host(slot, address), "begin": list(slot.node.begin)}  # type: ignore[attr-defined]
            for slot in run.pointers
        ]
        devices = [{**self._host(slot, address), **describe_device(slot)} for slot in run.devices]
        return {"pointers": pointers, "devices": devices}

    def _host(self, slot: Slot, address: Callable[[int], int]) -> dict[str, Any]:
        plan = self._plans[slot.name]
        return {
            "node": slot.name,
            "stream": slot.outputs[0].stream,
            "records": [address(address_of(each.record)) for each in self._run.entrances(slot)],
            "fields": _forms(slot.outputs[0].kind),
            "steps": address(address_of(plan.steps)),
            "count": len(plan.steps),
            "literals": address(address_of(plan.literals)),
            "buffer": address(address_of(self._buffer)),
        }


def describe_segment(segment: CompiledSegment, address: Callable[[int], int]) -> dict[str, Any]:
    """Addresses of the table, of the clock and of the journal, and of each stream.

    address  where an address of this process is in the memory of WebAssembly
    """
    rows, clock = (address(where) for where in segment.where)
    journal, entries = (address(address_of(array)) for array in segment.buffers())
    places = {name: clock + CLOCK.fields[name][1] for name in CLOCK.names or ()}  # type: ignore[index]
    return {
        "run": [rows, clock],
        "clock": {name: places[name] for name in ("failed", "why", "tick", "resume", "length", "entries")},
        "journal": journal,
        "entry": entries,
        "nodes": [slot.name for slot in segment.slots],
        "why": WHY,
        "streams": [each for slot, lines in segment.output_lines() for each in _streams(slot, lines, address)],
    }


def _streams(slot: Slot, lines: np.ndarray, address: Callable[[int], int]) -> list[dict[str, Any]]:
    """The outputs of a node, with the address of the word that says which of their messages go to the journal."""
    period = OUTPUT.fields["period"][1]  # type: ignore[index]
    return [
        {
            "name": output.stream,
            "node": slot.name,
            "kind": output.kind.__name__,
            "every": slot.every,
            "record": address(address_of(record_of(output))),
            "period": address(address_of(lines)) + place * OUTPUT.itemsize + period,
            "fields": _forms(output.kind),
        }
        for place, output in enumerate(slot.outputs)
    ]


def _forms(kind: type[Message]) -> dict[str, Any]:
    """Place and form of each field in the record of a message."""
    record = layout(kind)
    return {field.name: _form(field, *record.fields[field.name][:2]) for field in fields(kind)}  # type: ignore[index]


def _form(field: Field, dtype: np.dtype, at: int) -> dict[str, Any]:
    if field.dtype is not None:
        return {"at": at, "form": ARRAYS[field.dtype.str], "axes": len(field.shape), "unit": field.unit}
    if field.words:
        return {"at": at, "form": "word", "words": list(field.words), "unit": field.unit}
    if dtype.fields is not None:
        return {"at": at, "form": "list", "unit": field.unit}
    base, shape = dtype.subdtype or (dtype, ())
    several = {"f": "vector", "i": "integers"}
    form = several[base.kind] if shape else {"f": "number", "i": "integer", "b": "flag"}[base.kind]
    return {"at": at, "form": form, "unit": field.unit} | ({"count": int(np.prod(shape))} if shape else {})
