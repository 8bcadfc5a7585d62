"""Offline computation of bases, fingertips and laws: full finite elements, scans, fits."""
