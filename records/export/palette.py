"""The colours of everything that is drawn, in pictures and in exported scenes."""

INK = "#2b2b33"
FAINT = "#b9b9c4"
FINGER = "#e07a5f"
TISSUE = "#a4243b"
NORMAL = "#1f5f8b"
FRICTION = "#d97706"
SPEED = "#4c8c4a"
ENERGY = "#6d4c9f"
REGION_A = "#cfe3f2"
REGION_B = "#fbe3c0"
DEFORMATION = ["#f3dcd0", "#f2b48c", "#ec7f5b", "#d2434f", "#9c1c5b", "#5b1360", "#240b40"]
"""Colours of no to most deformation; lightness falls evenly, so that they can be told apart in grey, too."""
