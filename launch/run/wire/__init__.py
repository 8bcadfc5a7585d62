"""The sockets between the processes of a run, what goes over them, and listening to a run from outside."""
