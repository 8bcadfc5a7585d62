"""Deformable bodies. Each takes `Load`, sends `Surface`, and can stand in for any other."""

from palpate.nodes.deformation.beam_bundle import BeamBundle
from palpate.nodes.deformation.mass_spring import MassSpring
from palpate.nodes.deformation.reduced_fe import ReducedFE
from palpate.nodes.deformation.rigid import Rigid

__all__ = ["BeamBundle", "MassSpring", "ReducedFE", "Rigid"]
