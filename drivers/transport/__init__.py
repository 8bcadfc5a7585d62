"""The ways to a device. Each is a few methods narrow, so that an emulator can stand at its other end."""
