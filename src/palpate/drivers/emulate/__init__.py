"""Shared by the emulators, which implement the protocols of the devices so that a graph runs without hardware."""
