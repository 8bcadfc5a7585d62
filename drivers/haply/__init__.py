"""Haply's devices: the Inverse3 over its local service, the planar 2diy over a serial port."""
