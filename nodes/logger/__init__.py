"""Observers that record a run. A class is found by its name in any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.logger.mcap import Mcap

__all__ = ["Mcap"]

__getattr__, __dir__ = room(__name__)
