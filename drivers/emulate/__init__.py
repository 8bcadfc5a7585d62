"""What the emulators of devices share.

They speak the bytes of the real devices, and ship: a graph runs on them without hardware.
"""

from __future__ import annotations

from abc import ABC, abstractmethod


class EmulatedDevice(ABC):
    """A device at the other end of a serial line (`emulate.line.EmulatedLine`)."""

    @property
    def period(self) -> float:
        """[s] between two messages that it sends by itself; 0: it only answers."""
        return 0.0

    @abstractmethod
    def hear(self, data: bytes, now: int) -> list[bytes]:
        """Its answers to bytes that came at `now` [ns]."""

    def say(self, now: int) -> bytes:
        """What it says by itself."""
        return b""
