"""What there is to build graphs from."""
