"""Memory directly before an unreadable page, for compiled code that reads bytes of another process."""

import ctypes
import mmap

import numpy as np

from palpate.engine.wire_plan import wire_plan
from palpate.launch.run.hop.decode import FORM
from palpate.messages import Message
from palpate.messages.record import blank

PAGE = mmap.PAGESIZE


class Guarded:
    """Memory of some pages between two unreadable ones. `end`: address after it."""

    def __init__(self, pages: int) -> None:
        self._map = mmap.mmap(-1, (pages + 2) * PAGE)
        first = ctypes.addressof(ctypes.c_char.from_buffer(self._map))
        libc = ctypes.CDLL(None, use_errno=True)
        for page in (first, first + (pages + 1) * PAGE):
            assert libc.mprotect(ctypes.c_void_p(page), ctypes.c_size_t(PAGE), 0) == 0
        self.begin, self.end = first + PAGE, first + (pages + 1) * PAGE

    def put(self, data: bytes) -> int:
        """Write data directly before the unreadable page; returns its address."""
        ctypes.memmove(self.end - len(data), data, len(data))
        return self.end - len(data)


class Form:
    """The form of the messages of a type, for compiled code at `address`."""

    def __init__(self, kind: type[Message], source: str) -> None:
        self.plan, self.blank = wire_plan(kind, source), blank(kind)
        self._form, self._lengths = np.zeros(1, FORM), np.zeros(16, np.int64)
        for name, value in (
            ("steps", self.plan.steps.ctypes.data), ("count", len(self.plan.steps)),
            ("literals", self.plan.literals.ctypes.data), ("axes", self.plan.axes.ctypes.data),
            ("lengths", self._lengths.ctypes.data), ("letters", self.plan.letters),
            ("blank", self.blank.ctypes.data),
        ):  # fmt: skip
            self._form[name] = value
        self.address = self._form.ctypes.data
