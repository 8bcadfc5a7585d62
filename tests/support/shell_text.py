"""What the shell printed, independent of where its lines break, which depends on the lengths of paths."""


def unwrapped(text: str) -> str:
    """A text on one line, without the frame of an error."""
    return " ".join(text.replace("│", " ").split())
