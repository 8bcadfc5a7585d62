"""What is computed off-line into a basis, a finger or a law: full finite elements, scans, fits."""
