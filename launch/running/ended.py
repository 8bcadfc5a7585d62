"""The signal that ends a worker's loop."""


class Ended(Exception):
    """The last tick has been run, or the launcher has told the worker to stop."""
