"""Load steps: assembly, Newton's iteration, checkpoints."""
