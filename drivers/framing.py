"""Finding the frames of a protocol in the bytes that come off a line, whatever lies between them."""

from abc import ABC, abstractmethod
from typing import ClassVar, Generic, TypeVar

Frame = TypeVar("Frame")


class FrameReader(ABC, Generic[Frame]):
    """Cuts received bytes into frames; after a wrong one it goes on at the next head.

    head   of one or two bytes, with which each frame begins
    wrong  [1]  bytes that belonged to no frame
    """

    head: ClassVar[bytes]

    def __init__(self) -> None:
        self._rest = b""
        self.wrong = 0

    @abstractmethod
    def parse(self, data: bytes) -> tuple[Frame | None, int]:
        """The frame at the beginning of these bytes, and its length; None and 0 where there is none, and a length
        beyond the bytes where more of it has to come."""

    def clear(self) -> None:
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes; the frames among all that came."""
        rest, frames = self._rest + data, []
        while (start := rest.find(self.head)) >= 0:
            self.wrong += start
            rest = rest[start:]
            frame, length = self.parse(rest)
            if length > len(rest):
                break
            if frame is not None:
                frames.append(frame)
                rest = rest[length:]
            else:
                self.wrong += 1
                rest = rest[1:]
        else:
            begun = len(self.head) - 1 if rest.endswith(self.head[:-1]) else 0
            self.wrong += len(rest) - begun
            rest = rest[len(rest) - begun :]
        self._rest = rest
        return frames
