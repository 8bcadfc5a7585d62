"""Drivers of real devices, with their protocols and emulators (docs/devices.md).

transport  one narrow interface for each connection: FTDI over USB, HID, UDP, WebSocket
falcon, haply, hid, sensors  protocols: frames, drivers, and an emulator for each driver
emulate    shared by the emulators: the hand that holds a grip, faults
limits, guard  safety limits of each device, and the last step before the device that enforces them
connected  shared by the drivers: one connection that is opened and closed
exchange   the thread that communicates with a device, so that the force loop never waits for it

Usable without a graph. Needs numpy and the standard library; packages of an extra are imported when needed.
"""
