"""Observers that keep or pass on what a run says: a recording, streams for other tools. Each is found by its name in
any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.logger.mcap import Mcap

__all__ = ["Mcap"]

__getattr__, __dir__ = room(__name__)
