"""The group 'Studies and experiments' of the help."""

PANEL = "Studies and experiments"
ORDER = ("study", "experiment")
