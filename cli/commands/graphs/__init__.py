"""The group 'Graphs' of the help."""

PANEL = "Graphs"
ORDER = ("check", "plan", "list", "new")
