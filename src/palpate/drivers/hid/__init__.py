"""HID devices: an open protocol for haptic devices that people build."""
