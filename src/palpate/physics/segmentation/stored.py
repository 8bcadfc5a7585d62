"""The surface of a label of a segmentation as a mesh file, made once for each content of the file and label.

It is stored next to the bases, in `~/.cache/palpate/organs`, in metres. From there on it is a mesh file like any other.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from pathlib import Path
from typing import Any, NamedTuple

from palpate.compiler import kernel_cache
from palpate.compiler.trust import make_folder, may_read, user_cache
from palpate.physics.archive import replacing
from palpate.physics.errors import MeshError
from palpate.physics.geometry.mesh import write_ply
from palpate.physics.readable import check_file
from palpate.physics.segmentation.backing import Bone, bone_of, neighbours
from palpate.physics.segmentation.endings import ending_of
from palpate.physics.segmentation.inclusion import Inclusion, choose_organ, inclusion_of
from palpate.physics.segmentation.read import read_labels
from palpate.physics.segmentation.region import read_region
from palpate.physics.segmentation.surface import label_surface
from palpate.physics.segmentation.voxels import MOST_FILE

SIZE = 500_000_000  # [bytes] of all stored surfaces; the files of a run are in its recording
VERSION = 5  # Increase it whenever the surface of a file has other numbers; stored ones are then no longer found


class StoredSurface(NamedTuple):
    """A mesh file in metres, what it shows, what was changed on the way, the organ's label, its nodule and bone, if the
    label names them, and the labels next to the organ with their distances [m]."""

    path: Path
    name: str
    notes: tuple[str, ...]
    organ: str = ""
    inside: Inclusion | None = None
    bone: Bone | None = None
    near: tuple[tuple[str, float], ...] = ()


def store_surface(file: Path, label: int | str | None) -> StoredSurface:
    """The surface of a label, from the store or computed. MeshError: unusable, or the store cannot be written."""
    kept = user_cache() / "organs" / f"{_stem(file, label)}-{_key(file, label)}.ply"
    about = kept.with_suffix(".json")
    if (stored := _read(kept, about)) is not None:
        return stored
    image = read_labels(file)
    joined, segment, within, bones = choose_organ(image, label)
    bone, rigid = bone_of(joined, bones, segment) if bones else (None, None)
    made = label_surface(joined, segment)
    inside, region = (None, None) if within is None else inclusion_of(image, within, segment)
    if inside is not None and region is not None:
        inside = inside._replace(shape=str(kept.with_suffix(".npz")))
    if bone is not None:
        bone = bone._replace(shape=str(kept.with_suffix(".bone.npz")))
    name = f"label {segment} of {file}"
    first = (
        f"{name}: {1e6 * made.volume:.4g} cm³ of voxels of {' x '.join(f'{1e3 * side:.3g}' for side in image.spacing)} "
        f"mm, its surface encloses {made.enclosed / made.volume - 1.0:+.2%}"
    )
    notes = (first, *(f"{file}: {note}" for note in made.notes))
    found = StoredSurface(kept, name, notes, str(segment), inside, bone, () if bones else neighbours(joined, segment))
    try:
        make_folder(kept.parent)
        write_ply(kept, made.mesh)
        if region is not None:
            region.save(kept.with_suffix(".npz"))
        if rigid is not None:
            rigid.save(kept.with_suffix(".bone.npz"))
        with replacing(about) as part:
            text = json.dumps({**found._asdict(), "path": None, "sha256": _hash(kept)})
            part.write_text(text, encoding="utf-8")
        kernel_cache.remove_oldest(kept.parent, SIZE)
    except OSError as error:
        raise MeshError(f"{file}: its surface cannot be stored in {kept.parent}: {error.strerror}") from None
    return found


def _read(kept: Path, about: Path) -> StoredSurface | None:
    """A stored surface; None: it is missing, untrusted or damaged."""
    if not (may_read(kept) and may_read(about)):
        return None
    try:
        stored = json.loads(about.read_text(encoding="utf-8"))
        if stored["sha256"] == _hash(kept):
            inside = None if stored["inside"] is None else _inclusion(*stored["inside"])
            bone = None if stored["bone"] is None else _bone(*stored["bone"])
            near = tuple((str(name), float(away)) for name, away in stored["near"])
            notes = tuple(map(str, stored["notes"]))
            for each in kept.parent.glob(f"{kept.stem}.*"):
                os.utime(each)  # by which `remove_oldest` knows what is used
            return StoredSurface(kept, str(stored["name"]), notes, str(stored["organ"]), inside, bone, near)
    except (OSError, ValueError, LookupError, TypeError):
        pass  # it is made again
    return None


def _inclusion(name: Any, centre: Any, radius: Any, notes: Any, shape: Any) -> Inclusion:
    """ValueError, TypeError: other values than those of an inclusion, or its voxels cannot be read."""
    x, y, z = map(float, centre)
    if shape:
        _check_region(shape)
    return Inclusion(str(name), (x, y, z), float(radius), tuple(map(str, notes)), str(shape))


def _bone(name: Any, distance: Any, shape: Any) -> Bone:
    """ValueError, TypeError: other values than those of bone, or its voxels cannot be read."""
    _check_region(shape)
    return Bone(str(name), float(distance), str(shape))


def _check_region(shape: Any) -> None:
    if not may_read(Path(shape)):
        raise ValueError(f"{shape}: missing or untrusted")
    read_region(shape)


def _hash(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _stem(file: Path, label: int | str | None) -> str:
    words = [file.name[: -len(ending_of(file))], *([] if label is None else [str(label)])]
    return "-".join(re.sub(r"[^\w.]+", "_", word)[:60] for word in words)


def _key(file: Path, label: int | str | None) -> str:
    """Hash of what the surface depends on. MeshError: no file, or too large."""
    try:
        check_file(file, MOST_FILE)
        content = _hash(file)
    except OSError as error:
        raise MeshError(f"{file}: {error.strerror} (looked in {Path.cwd()})") from None
    return hashlib.sha256(f"{VERSION} {content} {label!s} {file.name}".encode()).hexdigest()[:16]
