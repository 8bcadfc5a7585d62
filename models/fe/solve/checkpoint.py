"""The file from which an interrupted run continues: load, displacement, the next step's size and direction, and the
multipliers of contact."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.physics.archive import replacing


class SolverState(NamedTuple):
    """Where a run is."""

    load: float  # reached
    displacement: np.ndarray  # [m] (N,3) there
    step: float  # size of the next one
    moved: float  # by how much the load went in the last step; 0: there is none to go on from
    change: np.ndarray  # [m] (N,3) what it changed


def write_state(path: str | Path, state: SolverState, contacts: Sequence[ContactPair]) -> None:
    """Write a converged state; a run that is killed meanwhile leaves the file as it was."""
    arrays = {name: np.asarray(value) for name, value in state._asdict().items()}
    for k, contact in enumerate(contacts):
        arrays |= {f"contact{k}.{name}": value for name, value in contact.state().items()}
    with replacing(Path(path)) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_state(path: str | Path, like: np.ndarray, contacts: Sequence[ContactPair]) -> SolverState:
    """The state in a file, and the multipliers into the contacts. ValueError: the file is not of `write_state`, or of
    another model than that of a displacement like this (N,3)."""
    try:
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        load, step, moved = (float(arrays[name]) for name in ("load", "step", "moved"))
        state = SolverState(load, arrays["displacement"], step, moved, arrays["change"])
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise ValueError(f"{path}: not a saved state ({error}); remove it to begin again") from None
    if state.displacement.shape != like.shape:
        raise ValueError(f"{path}: a state of {len(state.displacement)} nodes, the mesh has {len(like)}")
    kept = {name.partition(".")[0] for name in arrays if name.startswith("contact")}
    if len(kept) != len(contacts):
        raise ValueError(
            f"{path}: a state of {len(kept)} contacts, the model has {len(contacts)}; it is of another model"
        )
    states = []
    for k, contact in enumerate(contacts):
        head = f"contact{k}."
        own = {name.removeprefix(head): value for name, value in arrays.items() if name.startswith(head)}
        sizes, wanted = ({name: np.shape(x) for name, x in s.items()} for s in (own, contact.state()))
        if sizes != wanted:
            raise ValueError(f"{path}: contact {k} has {sizes}, the model's {wanted}; it is of another model")
        states.append(own)
    for contact, own in zip(contacts, states, strict=True):
        contact.restore(own)
    return state
