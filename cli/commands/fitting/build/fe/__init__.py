"""`palpate build fe`."""

HELP = "Run the full finite-element models."
ORDER = ("fingertip", "table")
