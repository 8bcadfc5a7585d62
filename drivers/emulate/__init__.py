"""What the emulators of devices share.

They speak the bytes of the real devices, and ship: a graph runs on them without hardware.
"""
