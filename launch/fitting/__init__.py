"""What `palpate fit` does: read sessions, choose models or fit a law, tell, write, draw."""
