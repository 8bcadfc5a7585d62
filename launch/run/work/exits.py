"""A node does not end a run that is one process: `os._exit` is that node's fault, as `sys.exit` is."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def exits_told() -> Iterator[None]:
    """While the block runs, `os._exit` raises SystemExit in it, which the run tells as an error of the node whose call
    it is. What was forked from here, and other threads, exit as they want."""
    leave, process, thread = os._exit, os.getpid(), threading.get_ident()

    def tell(status: int) -> None:
        if os.getpid() != process or threading.get_ident() != thread:
            leave(status)
        raise SystemExit(f"os._exit({status})")

    os._exit = tell  # type: ignore[assignment]
    try:
        yield
    finally:
        os._exit = leave
