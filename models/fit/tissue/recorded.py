"""A press from the messages of a palpate recording: of a force sensor and a device, or of a simulated contact."""

from collections.abc import Sequence

import numpy as np

from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import Press, prepared

APART = 0.02
"""[1] Of the greatest force, below which it does not press."""


def recorded_press(name: str, poses: Sequence[Pose], contacts: Sequence[Contact], bone: bool) -> Press:
    """The deepest press of one stream of contacts; that of poses says the way of a probe whose contact is measured.

    bone  whether indentation means the approach of the fingertip's bone, not the tissue's own

    SessionError: nothing that presses, and what `prepared` refuses.
    """
    force = np.array([m.force for m in contacts], float)
    if not len(force):
        raise SessionError(f"{name}: no messages of Contact, expected a press")
    time = np.array([m.time for m in contacts], float)
    depth = np.array([m.indentation + (m.compression if bone else 0.0) for m in contacts], float)
    if not depth.any():  # a sensor knows no indentation
        if not poses:
            raise SessionError(
                f"{name}: contacts of a force sensor and no stream of Pose, expected the way of its probe"
            )
        when = np.array([m.time for m in poses], float)
        depth = -np.interp(time, when, np.array([m.position for m in poses]) @ np.array(contacts[0].normal))
    own = _deepest_touch(depth, force)
    return prepared(name, 1e-9 * time[own], depth[own], force[own])


def _deepest_touch(depth: np.ndarray, force: np.ndarray) -> slice:
    """The rows of the touch that goes deepest, with the free motion before and after it."""
    pressed = force > APART * force.max()
    at = int(np.argmax(np.where(pressed, depth, -np.inf)))
    begin, end = at - int(np.argmin(pressed[at::-1])), at + int(np.argmin(pressed[at:]))
    begin, end = (begin if not pressed[begin] else 0), (end if not pressed[end] else len(force))
    before, after = np.flatnonzero(pressed[:begin]), np.flatnonzero(pressed[end:])
    return slice(int(before[-1]) + 1 if len(before) else 0, end + int(after[0]) if len(after) else len(force))
