"""What a picture leaves out where several contacts were recorded."""

from __future__ import annotations

from palpate.messages import Contact
from palpate.records.stored import Stored


def left_out(recording: Stored) -> str:
    """A line for people; "" where there is one contact or none."""
    first, *others = recording.streams_of(Contact) or [""]
    if not others:
        return ""
    return (
        f"{first!r} is shown with its body, the first of {1 + len(others)} contacts. The others: "
        f"palpate plot {recording.path} {' '.join(f'{name}.force' for name in others)}"
    )
