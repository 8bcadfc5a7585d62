"""Bounds of single touches that need more than a formula; the others are in `palpate.studies.organs.invariants`."""
