"""Deformable bodies: each takes `Load` and sends `Surface` with its terminal law, so one line swaps them."""

from palpate.nodes.deformation.beam_bundle import BeamBundle

__all__ = ["BeamBundle"]
