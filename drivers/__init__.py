"""Real devices: how bytes travel, what they mean, and emulators that speak them (docs/devices.md).

transport  one narrow seam for each way to a device: FTDI over USB, HID, UDP, WebSocket
falcon, haply, hid, sensors  protocols, byte for byte: frames, drivers, and an emulator for each driver
emulate    what the emulators share: the hand that holds a grip, bad days
limits, guard  what a device may do to a hand, as data, and the last step before the wire that holds it to that
connected  what protocols share: one connection that is opened and closed
exchange   the thread that talks to a device, so that the force loop never waits for it

Usable without a graph. numpy and the standard library; what an extra brings is imported when it is called.
"""
