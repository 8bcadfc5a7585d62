"""The probabilistic force model fitted to measured sessions."""
