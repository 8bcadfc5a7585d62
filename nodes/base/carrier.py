"""Nodes that forward messages of any type."""

from __future__ import annotations

from functools import cache
from typing import Self

from palpate.messages import Message
from palpate.nodes.base.node import Node


class Carrier(Node):
    """A node with one input, `message`, and one output of the same type, that of the sender.

    The loader calls `of` for the class, such as Delay[palpate.messages.device.Pose]. A subclass defines `carry`, which
    returns the message to send.
    """

    @classmethod
    @cache
    def of(cls, kind: type[Message]) -> type[Self]:
        """The subclass for messages of this type."""

        def step(self: Carrier, message: Message, *, dt: float) -> Message | None:
            return self.carry(message, dt)

        step.__annotations__ = {"message": kind, "return": kind}
        name = f"{cls.__name__}[{kind.__module__}.{kind.__qualname__}]"
        return type(name, (cls,), {"step": step, "__module__": cls.__module__, "__doc__": cls.__doc__})

    def carry(self, message: Message, dt: float) -> Message | None:
        """The message to send in a step of dt [s]; None: the last one again."""
        raise NotImplementedError

    def step(self, message: Message, *, dt: float) -> Message:
        raise NotImplementedError  # of no type yet
