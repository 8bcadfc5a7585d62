"""Meshes of fingertips and organs."""
