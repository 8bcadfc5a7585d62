"""The checks of `palpate doctor`: this machine, and the latency of its wake-ups."""
