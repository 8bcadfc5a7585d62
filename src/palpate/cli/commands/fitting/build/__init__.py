"""Build a basis, a fingertip or a page; run full FE models."""
