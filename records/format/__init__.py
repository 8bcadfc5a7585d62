"""The form of a recording as a file."""
