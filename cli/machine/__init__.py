"""What `palpate doctor` looks at: this machine, and how late it wakes a process."""
