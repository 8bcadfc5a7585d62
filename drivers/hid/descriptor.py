"""HID report descriptors: where in its reports a device keeps its axes and buttons.

USB Implementers' Forum, "Device Class Definition for Human Interface Devices", 1.11 (2001), section 6.2.2. Input items
of the pages Generic Desktop (axes X to Rz) and Button; all else is skipped.
"""

from dataclasses import dataclass

DESKTOP, BUTTON = 0x01, 0x09
AXES = range(0x30, 0x36)  # X Y Z Rx Ry Rz
GAMEPADS = (0x04, 0x05)  # joystick, gamepad: usages of the Generic Desktop page


@dataclass(frozen=True)
class ReportField:
    """One number in a report.

    report  its number, 0 where the device has none    page, usage  what it is
    offset, bits  where, in bits after the report's number    low, high  its range
    """

    report: int
    page: int
    usage: int
    offset: int
    bits: int
    low: int
    high: int

    def value(self, body: bytes) -> int | None:
        """The number in a report's body (without its number); None where the body is too short."""
        last = self.offset + self.bits
        if last > 8 * len(body):
            return None
        raw = int.from_bytes(body, "little") >> self.offset & (1 << self.bits) - 1
        return raw - (1 << self.bits) if self.low < 0 and raw >> self.bits - 1 else raw

    def scaled(self, body: bytes) -> float | None:
        """The number in -1 .. 1 over its range."""
        raw = self.value(body)
        if raw is None or self.high <= self.low:
            return None
        return min(max(2.0 * (raw - self.low) / (self.high - self.low) - 1.0, -1.0), 1.0)


def fields(descriptor: bytes) -> list[ReportField]:
    """The axes and buttons of a descriptor, in their order; what is cut off or unknown ends or is skipped."""
    entries: list[ReportField] = []
    state: dict[str, int] = {"page": 0, "low": 0, "high": 0, "size": 0, "count": 0, "report": 0}
    stack: list[dict[str, int]] = []
    usages: list[int] = []
    least: int | None = None
    offsets: dict[int, int] = {}
    at = 0
    while at < len(descriptor):
        head = descriptor[at]
        if head == 0xFE:  # a long item
            at += 3 + (descriptor[at + 1] if at + 1 < len(descriptor) else 0)
            continue
        length = (0, 1, 2, 4)[head & 3]
        data = descriptor[at + 1 : at + 1 + length]
        at += 1 + length
        number = int.from_bytes(data, "little")
        signed = int.from_bytes(data, "little", signed=True)
        match head & 0xFC:
            case 0x04:
                state["page"] = number
            case 0x14:
                state["low"] = signed
            case 0x24:
                state["high"] = number if state["low"] >= 0 else signed
            case 0x74:
                state["size"] = number
            case 0x94:
                state["count"] = number
            case 0x84:
                state["report"] = number
            case 0xA4:
                stack.append(dict(state))
            case 0xB4 if stack:
                state = stack.pop()
            case 0x08:
                usages.append(number if length == 4 else state["page"] << 16 | number)
            case 0x18:
                least = number
            case 0x28 if least is not None:
                usages += [state["page"] << 16 | u for u in range(least, min(number, least + 255) + 1)]
            case 0x80:
                entries += _input(state, usages, offsets, constant=bool(number & 1), array=not number & 2)
                usages, least = [], None
            case 0x90 | 0xB0 | 0xA0 | 0xC0:
                usages, least = [], None
    return entries


def _input(
    state: dict[str, int], usages: list[int], offsets: dict[int, int], constant: bool, array: bool
) -> list[ReportField]:
    begin = offsets.get(state["report"], 0)
    count, size = min(state["count"], 512), state["size"]
    offsets[state["report"]] = begin + count * size
    if constant or array or not usages or not 0 < size <= 32:
        return []
    made = []
    for i in range(count):
        page, usage = divmod(usages[min(i, len(usages) - 1)], 1 << 16)
        if page == BUTTON or (page == DESKTOP and usage in AXES):
            made.append(ReportField(state["report"], page, usage, begin + i * size, size, state["low"], state["high"]))
    return made
