"""The group 'Run and touch' of the help."""

PANEL = "Run and touch"
ORDER = ("run", "touch", "view", "top")
