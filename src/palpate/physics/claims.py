"""Sizes that a file states: compared with its length before memory is reserved for them.

Compressed and sparse contents may be longer than the file: by `RATIO`, and any file may hold `FREE` bytes. A grey image
compresses 2 to 5 times, a mask 50 to 500 times, a table 2 to 10 times.
"""

import os
import zipfile
from pathlib import Path

RATIO = 200  # [1] Contents over the length of their file
FREE = 64 << 20  # [bytes] that any file may hold
MOST = 1 << 32  # [bytes] that no file may exceed


def largest_content(held: int, ratio: int = RATIO) -> int:
    """Largest contents [bytes] of a file with this length [bytes]."""
    return min(MOST, max(FREE, ratio * held))


def check_claim(what: str, claimed: int, held: int, ratio: int = RATIO) -> None:
    """ValueError: contents of `claimed` bytes, as `what` states, are too many for a file of `held` bytes."""
    most = largest_content(held, ratio)
    if not 0 <= claimed <= most:
        raise ValueError(
            f"{what} claims {claimed} bytes, at most {most} are expected of a file with {held}: it is damaged, or made"
            " to exhaust the memory. If its contents are right, write it without compression and without empty parts"
        )


def check_zip(path: Path) -> None:
    """ValueError, OSError, zipfile.BadZipFile: not a zip archive, or its members unpack to too many bytes."""
    with zipfile.ZipFile(path) as archive:
        check_claim("its directory", sum(member.file_size for member in archive.infolist()), path.stat().st_size)


def stored_bytes(folder: Path) -> int:
    """Length of all files in a folder and its subfolders [bytes], such as that of a zarr store."""
    found, left = 0, [folder]
    while left:
        with os.scandir(left.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    left.append(Path(entry.path))
                elif entry.is_file():
                    found += entry.stat().st_size
    return found
