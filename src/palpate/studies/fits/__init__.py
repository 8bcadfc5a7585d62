"""Random presses of every rig and law, and whether `palpate fit tissue` finds what made them (docs/fit_tissue.md)."""
