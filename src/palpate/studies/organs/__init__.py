"""Touch organs of any shape at random, and check that the force remains bounded and smooth (docs/your_organ.md)."""
