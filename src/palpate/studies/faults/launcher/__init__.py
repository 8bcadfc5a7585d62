"""Faults of processes and of their connections in virtual time: a random search for those that leave a run waiting,
name the wrong node, or leave a process behind."""
