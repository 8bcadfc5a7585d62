"""`palpate remote`."""

HELP = "Spread a run over several machines: keys and workers."
ORDER = ("keys", "join")
