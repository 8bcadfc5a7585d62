"""How a load on the fine surface acts on the coarse one of a condensed body, which widens it."""
