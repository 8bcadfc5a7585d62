"""Deformable bodies. Each takes `Load`, sends `Surface`, and can stand in for any other; it is found by its name in any
file of this folder."""

from typing import Any

from palpate.nodes.base.room import class_of, offered
from palpate.nodes.deformation.adaptive import Adaptive
from palpate.nodes.deformation.beam_bundle import BeamBundle
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.nodes.deformation.rigid import Rigid

__all__ = ["Adaptive", "BeamBundle", "MassSpring", "ReducedFE", "Rigid"]


def models() -> list[str]:
    """Names of the bodies that stand in for any organ, as `use:` takes them: those that declare a `rank`, which says
    how near a body is to full finite elements, the nearest first."""
    ranks = {f"deformation.{name}": vars(class_of(__name__, __path__, name)).get("rank") for name in offered(__path__)}
    return sorted((name for name, rank in ranks.items() if rank), key=lambda name: (-(ranks[name] or 0), name))


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
