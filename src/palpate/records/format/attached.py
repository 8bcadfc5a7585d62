"""Data files of a run in its recording, so that it can be replayed and drawn where these are missing, or have changed:
the mesh of an organ, a map of its stiffness, the voxels of a label.

Each is an attachment of MCAP before the first message, compressed by zstd, with the path in the settings as its name.
`palpate.about` has the hashes of all, also of those that are too large to be attached.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import zstandard

from palpate.compiler import kernel_cache
from palpate.compiler.trust import make_folder, may_read, user_cache
from palpate.physics.archive import replacing
from palpate.physics.readable import DATA, hash_of_file, short_hash
from palpate.records.format.mcap_file import MOST_HEAD, Broken, McapRecords
from palpate.records.format.mcap_writer import McapWriter

MEDIA = "application/zstd"
MOST = MOST_HEAD - (1 << 16)  # [bytes] of a compressed file; a larger one is not attached
LARGEST = 1 << 28  # [bytes] of a file
SIZE = 500_000_000  # [bytes] of all copies in the cache


def attach_files(writer: McapWriter, files: Mapping[str, str]) -> None:
    """Attach the files, names with hashes, that are still what the hashes say and not too large."""
    for name, expected in files.items():
        with suppress(OSError):
            if Path(name).stat().st_size > LARGEST:
                continue
            data = Path(name).read_bytes()
            packed = zstandard.ZstdCompressor(level=3).compress(data)
            if short_hash(data) == expected and len(packed) <= MOST:
                writer.add_attachment(name, MEDIA, packed)


def attached_files(path: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each attached file that can be read."""
    with suppress(OSError, Broken), path.open("rb") as file:
        for name, media, packed in McapRecords(file).attachments():
            with suppress(zstandard.ZstdError):
                if media == MEDIA and 0 <= zstandard.frame_content_size(packed) <= LARGEST:
                    yield name, zstandard.ZstdDecompressor().decompress(packed)


def copy_attached(path: Path, writer: McapWriter, names: Mapping[str, str]) -> None:
    """Attach the files of a recording to a copy of it, with other names for those in `names`."""
    with suppress(OSError, Broken), path.open("rb") as file:
        for name, media, packed in McapRecords(file).attachments():
            writer.add_attachment(names.get(name, name), media, packed)


def restore_files(path: Path, files: Mapping[str, str]) -> tuple[dict[str, str], dict[str, str]]:
    """Replacements of the files, names with hashes, that are missing here or have changed: by name the path of the copy
    in the recording, in the user's cache; and by name what is wrong with each of these files, in words."""
    wrong = {}
    for name, expected in files.items():
        if (found := hash_of_file(name)) != expected:
            wrong[name] = "has changed" if found else "is missing"
    kept: dict[str, str] = {}
    if not wrong:
        return kept, wrong
    for name, data in attached_files(path):
        expected = files.get(name, "")
        suffix = Path(name).suffix.lower()
        if name not in wrong or suffix not in DATA or short_hash(data) != expected:
            continue
        target = user_cache() / "recorded" / f"{expected}{suffix}"
        with suppress(OSError):
            if may_read(target) and hash_of_file(target) == expected:
                os.utime(target)  # by which `remove_oldest` knows what is used
            else:
                make_folder(target.parent)
                with replacing(target, cached=True) as part:
                    part.write_bytes(data)
                kernel_cache.remove_oldest(target.parent, SIZE)
            kept[name] = str(target)
    return kept, wrong


def renamed(data: Any, names: Mapping[str, str]) -> Any:
    """Plain data in which each of these texts is replaced."""
    if isinstance(data, str):
        return names.get(data, data)
    if isinstance(data, Mapping):
        return {renamed(key, names): renamed(value, names) for key, value in data.items()}
    return [renamed(value, names) for value in data] if isinstance(data, list) else data
