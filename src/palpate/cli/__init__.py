"""The command line: commands, their help, tables and progress."""
