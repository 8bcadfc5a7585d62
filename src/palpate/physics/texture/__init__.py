"""Texture: fluctuation of the force of a sliding contact."""
