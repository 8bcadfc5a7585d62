"""A press from the messages of a palpate recording: of a force sensor and a device, or of a simulated contact."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import Press, prepared


def recorded_press(name: str, poses: Sequence[Pose], contacts: Sequence[Contact], bone: bool) -> Press:
    """The press of one stream of contacts; that of poses says the way of a probe whose contact is measured.

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
    return prepared(name, 1e-9 * time, depth, force)
