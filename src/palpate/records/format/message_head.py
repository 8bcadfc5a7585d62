"""Head of a message record of an MCAP file, which precedes its payload."""

import numpy as np

MESSAGE = 5  # kind of the record (`mcap.opcode.Opcode.MESSAGE`)
HEAD = np.dtype(
    [("kind", "u1"), ("length", "<u8"), ("channel", "<u2"), ("tick", "<u4"), ("time", "<u8"), ("at", "<u8")]
)
"""Kind and length of the record; channel, sequence number, and two times [ns] of the message."""
HEAD_LENGTH = HEAD.itemsize - 9  # [bytes] of a head that count for the length of its record: all but kind and length
