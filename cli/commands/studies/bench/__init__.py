"""`palpate bench`: accuracy and speed of the models, and stability of the loop with your device."""

HELP = "Benchmark the models and the haptic loop."
