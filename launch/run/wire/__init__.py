"""The sockets between the processes of a run, their protocol, and access to a run from other programs."""
