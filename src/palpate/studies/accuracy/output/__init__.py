"""Output of the accuracy benchmark: table, page, pictures and recommendation."""
