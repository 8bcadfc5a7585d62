"""Tactile quantities in addition to the force. A class is found by its name in any file of this folder."""

from palpate.nodes.base.room import room

__getattr__, __dir__ = room(__name__)
