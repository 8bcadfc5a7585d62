"""`palpate fe`: finite-element runs."""

HELP = "Run the full finite-element models."
ORDER = ("fingertip", "compare", "table", "laws")
