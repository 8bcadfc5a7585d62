"""The launcher: load, check, plan, place, run, record, replay, and the command line."""
