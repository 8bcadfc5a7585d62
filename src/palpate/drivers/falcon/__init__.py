"""The Novint Falcon: three motors and three encoders behind an FTDI chip.

Protocol as in the open driver libnifalcon (K. Machulis and others, 2007-2019, BSD licence), reimplemented.
"""

VENDOR, PRODUCT = 0x0403, 0xCB48
NAME = "Novint Falcon"
