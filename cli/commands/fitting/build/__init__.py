"""`palpate build`."""

HELP = "Build a basis, a fingertip from scans, or run full FE."
ORDER = ("basis", "fingertip", "fe")
