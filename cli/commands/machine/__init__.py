"""This machine: devices, keys, diagnostics."""
