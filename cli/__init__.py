"""What people type: commands, their help, tables and progress."""
