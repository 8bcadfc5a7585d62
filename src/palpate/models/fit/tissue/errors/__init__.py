"""Noise of a press: the errors of the unknowns that it causes, and a hum that is fitted with them."""
