"""Connections to a device. Each has only a few methods, so that an emulator can replace the device."""
