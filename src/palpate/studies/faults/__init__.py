"""Faults of messages and nodes in virtual time: a random search for those that raise, lose or keep a force."""
