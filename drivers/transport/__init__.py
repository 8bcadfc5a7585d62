"""The connections to a device. Each has only a few methods, so that an emulator can take the place of the device."""
