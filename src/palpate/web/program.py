"""The code, the memory and the description of several runs that share one module of WebAssembly."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from palpate.compiler.kernel import CompiledKernel
from palpate.compiler.wasm.link import Kernel, LinkError, link
from palpate.compiler.wasm.object_file import Linked
from palpate.engine.segment import CompiledSegment, kernels
from palpate.engine.slot import Slot
from palpate.nodes.base.compiled import CompiledNode, arguments
from palpate.physics.materials.compiled import law_signature
from palpate.physics.materials.hyperelastic import known_places
from palpate.web.describe import Hosts, describe_segment
from palpate.web.errors import WebError
from palpate.web.image import BEGIN, MemoryImage, calling_words
from palpate.web.started import Started

LEAST_STACK = 1 << 18  # [bytes] of memory for the stack, between the static data and the arrays


@dataclass
class Program:
    """Code that runs the segments of several variants.

    code   the linked module
    parts  the memory of all variants, by its hash
    """

    code: Linked
    functions: dict[int, int]
    parts: dict[str, bytes] = field(default_factory=dict)

    def describe(self, run: Started) -> dict[str, Any]:
        """The description of a variant, whose memory is added to `parts`. Its nodes have started and not stepped."""
        hosts = Hosts(run)
        image = MemoryImage(run.segment, self.functions, hosts.arrays)
        parts = []
        for part in image.parts:
            digest = hashlib.sha256(part.data).hexdigest()
            self.parts[digest] = part.data
            parts.append({"at": part.at, "hash": digest})
        return {
            "rate": run.planned.graph.rate,
            "table": 1 + len(self.code.table),
            "size": image.size,
            "parts": parts,
            **hosts.describe(image.address),
            **describe_segment(run.segment, image.address),
        }

    def save(self, folder: Path, about: dict[str, Any]) -> None:
        """Write the code, the parts and the description of a variant as they are, for programs that measure or compare
        ticks."""
        (folder / "about.json").write_text(json.dumps(about), encoding="utf-8")
        (folder / "tick.wasm").write_bytes(self.code.code)
        for digest, data in self.parts.items():
            (folder / digest).write_bytes(data)


def compile_program(segments: Iterable[CompiledSegment]) -> Program:
    """The code of all kernels of these segments. WebError: a kernel cannot run in WebAssembly."""
    from palpate.engine.compiled_tick import run_table  # the compiler is slow to import
    from palpate.engine.encode import encode

    found: dict[int, Kernel] = {}
    for segment in segments:
        for slot in segment.slots:
            kind: Any = type(slot.node)
            for native, kernel in zip(kernels(kind, slot.sleeps), _kernels(kind), strict=True):
                if native and kernel is not None:
                    found[native] = kernel
            found |= _laws(slot)
    words = (types.int64,)
    exports = {"run": Kernel(run_table, words * 4), "encode": Kernel(encode, words * 7)}
    try:
        code, indices = link(list(found.values()), exports)
    except LinkError as error:
        raise WebError(str(error)) from None
    if BEGIN - code.data < LEAST_STACK:
        raise WebError(f"static data of {code.data} bytes: expected at most {BEGIN - LEAST_STACK}")
    return Program(code, dict(zip(found, indices, strict=True)))


def _laws(slot: Slot) -> dict[int, Kernel]:
    """The material laws that a node calls by the addresses in its arrays. WebError: one is no kernel."""
    known, found = known_places(), dict[int, Kernel]()
    for words in calling_words(slot.node, known):
        for place in words[np.isin(words, list(known))].tolist():
            law, name = known[place]
            if not isinstance(law, CompiledKernel):
                raise WebError(
                    f"{slot.name!r} ({type(slot.node).__name__}) calls the law {name!r}, which numba compiles for "
                    "this processor; expected a law under @kernel(pointer=True), as in palpate.physics.materials"
                )
            found[place] = Kernel(law, law_signature().args, law_signature().return_type)
    return found


def _kernels(kind: type[CompiledNode]) -> tuple[Kernel, Kernel | None]:
    """The kernels of a node class: a step, and the test for rest."""
    from numba import from_dtype

    given = (*map(from_dtype, arguments(kind)), types.float64)
    return Kernel(kind.compute, given), Kernel(kind.idle, given) if kind.idle is not None else None
