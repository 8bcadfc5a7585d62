"""The relations, in files by kind; no list names them. Each file has a tuple `RELATIONS`."""

from __future__ import annotations

import sys

from palpate.physics.errors import ArgumentError
from palpate.registry import modules
from palpate.studies.relations.relation import Relation


def relations() -> dict[str, Relation]:
    """All relations by name."""
    files = modules(sys.modules[__name__]).values()
    return {one.name: one for file in files for one in file.RELATIONS}


def choose_relations(names: list[str] | None) -> list[Relation]:
    """These relations, or all. ArgumentError: an unknown name."""
    known = relations()
    if unknown := [name for name in names or () if name not in known]:
        raise ArgumentError(f"--relation: found {', '.join(unknown)}, expected some of {', '.join(known)}")
    return [known[name] for name in names or known]
