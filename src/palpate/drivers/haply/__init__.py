"""Haply's Inverse3 over its local service."""
