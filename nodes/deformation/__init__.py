"""Deformable bodies. Each takes `Load` and sends `Surface`, so they are interchangeable.

A class is found by its name in any file of this folder.
"""

import sys

from palpate.nodes.base.node import Node
from palpate.nodes.base.room import room
from palpate.nodes.deformation.beam_bundle import BeamBundle
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.nodes.deformation.rigid import Rigid
from palpate.registry import classes, declared_classes, registered_modules

__all__ = ["BeamBundle", "MassSpring", "ReducedFE", "Rigid"]


def bodies() -> dict[str, type[Node]]:
    """The bodies that can replace any organ, by their name for `use:`, including those of other distributions.

    These are the bodies with a `rank`, which orders them by accuracy; the nearest to full finite elements is the first.
    """
    every = {f"deformation.{name}": kind for name, kind in classes(sys.modules[__name__], Node).items()}
    for module in registered_modules("palpate.nodes")[0].values():
        every |= {f"{module.__name__}.{kind.__name__}": kind for kind in declared_classes(module, Node)}
    ranks = {name: vars(kind)["rank"] for name, kind in every.items() if vars(kind).get("rank")}
    return {name: every[name] for name in sorted(ranks, key=lambda name: (-ranks[name], name))}


__getattr__, __dir__ = room(__name__)
