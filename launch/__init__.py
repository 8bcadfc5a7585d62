"""The launcher: loads, checks, plans and places graphs (`load`), and runs and supervises them (`run`)."""
