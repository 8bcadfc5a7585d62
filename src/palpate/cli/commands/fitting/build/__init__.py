"""Build a basis, or a fingertip from scans; run full FE models."""
