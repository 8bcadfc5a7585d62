"""The felt surface: the part of a surface that a finger with a width can touch, and bridges over what it cannot."""
