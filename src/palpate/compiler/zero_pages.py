"""Memory that is zero at first and takes physical memory only for the pages that are written, for lanes.

`np.zeros` gives memory of this kind only where the C library maps it: a block from its heap is cleared by writing to
it, which took 130 kB a lane. So lanes lie one after another in large mappings of the operating system.
"""

import mmap
from collections import defaultdict
from typing import Any

import numpy as np

PAGE = mmap.PAGESIZE
CHUNK = 1 << 26  # [bytes] Size of a mapping, unless a block is larger
PRIVATE: dict[str, Any] = (
    {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if hasattr(mmap, "MAP_ANONYMOUS") else {}
)  # a child after a fork has a copy; on Windows a mapping without a file belongs to the process


class ZeroPages:
    """Blocks of zeros, each at the begin of a page."""

    def __init__(self) -> None:
        self._chunk, self._at = np.zeros(0, np.uint8), 0
        self._free: defaultdict[int, list[np.ndarray]] = defaultdict(list)

    def take(self, size: int) -> np.ndarray:
        """A block of at least `size` bytes, all 0."""
        size = -(-size // PAGE) * PAGE
        if self._free[size]:
            block = self._free[size].pop()
            pages = _pages(block)
            pages[pages.any(axis=1)] = 0  # the others take no physical memory and stay so
            return block
        if self._at + size > len(self._chunk):
            self._chunk, self._at = np.frombuffer(mmap.mmap(-1, max(CHUNK, size), **PRIVATE), np.uint8), 0
        self._at += size
        return self._chunk[self._at - size : self._at]

    def give(self, block: np.ndarray) -> None:
        """Take back a block that is no longer used."""
        self._free[len(block)].append(block)


def written_bytes(block: np.ndarray) -> int:
    """Size [bytes] of the pages of a block that are not zero."""
    return PAGE * int(_pages(block).any(axis=1).sum())


def _pages(block: np.ndarray) -> np.ndarray:
    return block.view(np.int64).reshape(-1, PAGE // 8)
