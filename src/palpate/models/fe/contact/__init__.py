"""Contact of elastic bodies with rigid ones and with each other."""
