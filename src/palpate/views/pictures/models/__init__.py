"""Pictures of fits, scanned fingertips, published tissues, and compared variants: not of one recording."""
