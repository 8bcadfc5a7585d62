"""Errors of a full or unavailable disk, for results that are written piece by piece."""

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from palpate.physics.errors import RunError


@contextlib.contextmanager
def disk_errors(place: Path | str, kept: str) -> Iterator[None]:
    """Turn an OSError of the block into a RunError that names the cause, what is kept, and what would help.

    kept  what was written before, such as "All points in points.parquet stay"
    """
    try:
        yield
    except OSError as error:
        why = error.strerror or str(error)
        cure = "Free some space and run" if error.errno in (errno.ENOSPC, errno.EDQUOT) else "Run"
        raise RunError(f"{place}: {why}. {kept}. {cure} it again to continue") from None
