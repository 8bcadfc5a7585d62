"""The compiled hop: workers whose nodes are all compiled read, step and send many ticks in one call."""
