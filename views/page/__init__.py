"""A page in the browser where the mouse is the finger: `palpate touch`."""
