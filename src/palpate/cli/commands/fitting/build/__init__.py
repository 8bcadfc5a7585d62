"""Build a basis, a fingertip from scans, or a web page; run full FE models."""
