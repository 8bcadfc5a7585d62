"""The group 'Accuracy and cost' of the help."""

PANEL = "Accuracy and cost"
ORDER = ("bench", "tune", "rates")
