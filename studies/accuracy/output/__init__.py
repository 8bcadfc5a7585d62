"""The results of the accuracy bench: table, page, pictures, and what to take."""
