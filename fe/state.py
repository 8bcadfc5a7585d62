"""The file that a broken run goes on from: load, displacement and the multipliers of contact."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from palpate.fe.contact import ContactPair


def write_state(path: str | Path, load: float, displacement: np.ndarray, contacts: Sequence[ContactPair]) -> None:
    """Write a converged state; a run that is killed meanwhile leaves the file as it was."""
    found = {"load": np.array(load), "displacement": displacement}
    for k, contact in enumerate(contacts):
        found |= {f"contact{k}.{name}": value for name, value in contact.state().items()}
    path = Path(path)
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        np.savez(file, allow_pickle=False, **found)
    part.replace(path)


def read_state(path: str | Path, like: np.ndarray, contacts: Sequence[ContactPair]) -> tuple[float, np.ndarray]:
    """Load and displacement of a file, and the multipliers into the contacts.

    ValueError: the file is not of `write_state`, or of another model than that of a displacement like this (N,3).
    """
    try:
        with np.load(path) as file:
            found = {name: file[name] for name in file.files}
        load, displacement = float(found["load"]), found["displacement"]
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise ValueError(f"{path}: not a saved state ({error}); remove it to begin again") from None
    if displacement.shape != like.shape:
        raise ValueError(f"{path}: a state of {len(displacement)} nodes, the mesh has {len(like)}")
    kept = {name.partition(".")[0] for name in found if name.startswith("contact")}
    if len(kept) != len(contacts):
        raise ValueError(
            f"{path}: a state of {len(kept)} contacts, the model has {len(contacts)}; it is of another model"
        )
    states = []
    for k, contact in enumerate(contacts):
        head = f"contact{k}."
        own = {name.removeprefix(head): value for name, value in found.items() if name.startswith(head)}
        sizes, wanted = ({name: np.shape(x) for name, x in s.items()} for s in (own, contact.state()))
        if sizes != wanted:
            raise ValueError(f"{path}: contact {k} has {sizes}, the model's {wanted}; it is of another model")
        states.append(own)
    for contact, own in zip(contacts, states, strict=True):
        contact.restore(own)
    return load, displacement
