"""What was prepared of an organ before, stored for later runs."""
