"""HID devices: 3Dconnexion's six-axis mice, and an open protocol for haptic devices that people build."""
