"""Benchmark the models, and the haptic loop of a device."""
