"""`palpate fit`."""

HELP = "Fit a force model, a material or a body to data."
ORDER = ("tissue", "record", "force", "body")
