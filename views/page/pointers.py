"""Sends samples of the page's pointers to the hands of a run."""

import contextlib
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec

from palpate.messages import Vector3
from palpate.nodes.device.mouse import FARTHEST
from palpate.views.errors import PageError

Count = Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
Metres = Annotated[float, msgspec.Meta(ge=-FARTHEST, le=FARTHEST)]
Sample = tuple[Count, tuple[Metres, Metres, Metres], Count]  # number, position [m, world] and buttons


class Pointers:
    """Forwards pointer samples; the page that sent the last one steers.

    sockets  one for each finger
    begins   [m] (3) start of each finger, to which it returns when the steering page closes
    """

    def __init__(self, sockets: Sequence[Path], begins: Sequence[Vector3]) -> None:
        self.sockets, self.begins = sockets, begins
        self._outlet = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._outlet.setblocking(False)
        self._steering: object = None

    def steer(self, page: object, finger: int, sample: Sample) -> None:
        """Forward a sample of a page. PageError: no such finger."""
        if finger >= len(self.sockets):
            raise PageError(f"finger: found {finger}, expected less than {len(self.sockets)}")
        self._steering = page
        self._send(finger, sample)

    def leave(self, page: object) -> None:
        """A page closes: if it steered, its hands return to their start."""
        if self._steering is page:
            self._steering = None
            for finger, begin in enumerate(self.begins):
                self._send(finger, (0, begin, 0))

    def close(self) -> None:
        self._outlet.close()

    def _send(self, finger: int, sample: Sample) -> None:
        """Send a sample; it is lost while no run is active."""
        with contextlib.suppress(OSError):
            self._outlet.sendto(msgspec.msgpack.encode(sample), str(self.sockets[finger]))
