"""Fits to measurements: the probabilistic force model, material laws of tissue, textures."""
