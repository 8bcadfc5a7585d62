"""Checkpoint of a run: load, displacement, size and direction of the next step, contact multipliers."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np

from palpate.models.fe.contact.protocol import ContactPair
from palpate.physics.archive import replacing


class SolverState(NamedTuple):
    """State of a run."""

    load: float  # reached
    displacement: np.ndarray  # [m] (N,3) there
    step: float  # size of the next step
    moved: float  # change of the load in the last step; 0: no step to extrapolate
    change: np.ndarray  # [m] (N,3) change of the displacement in the last step


def write_state(path: str | Path, state: SolverState, contacts: Sequence[ContactPair]) -> None:
    """Write a converged state atomically."""
    arrays = {name: np.asarray(value) for name, value in state._asdict().items()}
    for k, contact in enumerate(contacts):
        arrays |= {f"contact{k}.{name}": value for name, value in contact.state().items()}
    with replacing(Path(path)) as part, part.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


def read_state(path: str | Path, like: np.ndarray, contacts: Sequence[ContactPair]) -> SolverState:
    """Read a state, and restore the contact multipliers. ValueError: not a file of `write_state`, or of a model with
    other nodes than the displacement `like` (N,3) or other contacts."""
    try:
        with np.load(path) as file:
            arrays = {name: file[name] for name in file.files}
        load, step, moved = (float(arrays[name]) for name in ("load", "step", "moved"))
        state = SolverState(load, arrays["displacement"], step, moved, arrays["change"])
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise ValueError(f"{path}: not a saved state ({error}); remove it to start again") from None
    if state.displacement.shape != like.shape:
        raise ValueError(f"{path}: a state of {len(state.displacement)} nodes, the mesh has {len(like)}")
    kept = {name.partition(".")[0] for name in arrays if name.startswith("contact")}
    if len(kept) != len(contacts):
        raise ValueError(f"{path}: a state of another model, with {len(kept)} contacts instead of {len(contacts)}")
    states = []
    for k, contact in enumerate(contacts):
        head = f"contact{k}."
        stored = {name.removeprefix(head): value for name, value in arrays.items() if name.startswith(head)}
        sizes, wanted = ({name: np.shape(x) for name, x in s.items()} for s in (stored, contact.state()))
        if sizes != wanted:
            raise ValueError(f"{path}: a state of another model: contact {k} has {sizes}, expected {wanted}")
        states.append(stored)
    for contact, stored in zip(contacts, states, strict=True):
        contact.restore(stored)
    return state
