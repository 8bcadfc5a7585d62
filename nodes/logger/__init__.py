"""Observers that keep or pass on what a run says: a recording, streams for other tools. Each is found by its name in
any file of this folder."""

from typing import Any

from palpate.nodes.base.room import class_of
from palpate.nodes.logger.mcap import Mcap

__all__ = ["Mcap"]


def __getattr__(name: str) -> Any:
    return class_of(__name__, __path__, name)
