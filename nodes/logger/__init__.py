"""Observers that keep what a run says: a recording. Each is found by its name in any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.logger.mcap import Mcap

__all__ = ["Mcap"]

__getattr__, __dir__ = room(__name__)
