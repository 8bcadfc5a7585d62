"""Checks of an HDF5 file before its arrays are read."""

from pathlib import Path
from typing import Any

from palpate.physics.claims import check_claim


def check_hdf5(path: Path) -> None:
    """Check the links and arrays of an HDF5 file without reading them.

    ValueError, OSError: it refers to another file, or its arrays are too large for it. ModuleNotFoundError: no h5py.
    """
    import h5py

    with h5py.File(path, "r", locking=False) as file:
        left: list[tuple[str, Any]] = [("", file)]
        seen: set[Any] = set()
        claimed = 0
        while left:
            name, group = left.pop()
            for key in group:
                inner, link = f"{name}/{key}", group.get(key, getlink=True)
                if isinstance(link, h5py.ExternalLink):
                    raise ValueError(f"{inner} is in another file, {link.filename!r}; copy it into this one")
                if isinstance(link, h5py.SoftLink):
                    continue  # names an object that has another link here
                member = group[key]
                address = h5py.h5o.get_info(member.id).addr
                if address in seen:
                    continue
                seen.add(address)
                if isinstance(member, h5py.Group):
                    left.append((inner, member))
                elif isinstance(member, h5py.Dataset):
                    if member.external or member.is_virtual:
                        raise ValueError(f"{inner} is in another file; copy it into this one")
                    claimed += member.size * member.dtype.itemsize if member.size else 0
        check_claim("the arrays in it", claimed, path.stat().st_size)
