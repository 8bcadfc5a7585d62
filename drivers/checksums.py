"""Check sums of frames."""


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25: reflected polynomial 0x1021, begins with all ones, inverted. 0x906E for b"123456789"."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
    return value ^ 0xFFFF
