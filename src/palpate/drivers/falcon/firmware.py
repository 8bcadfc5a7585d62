"""Loads the firmware into a Falcon, which loses it when it is switched off.

palpate does not contain the image; the user provides it. It came with the manufacturer's driver, and the source tree of
the open driver has it as `firmware/nvent_firmware.bin`. Loading fails occasionally and is retried.
"""

from collections.abc import Callable
from pathlib import Path

from palpate.drivers.errors import DeviceError
from palpate.drivers.transport import ftdi
from palpate.drivers.transport.ftdi import Ftdi, payload
from palpate.physics.readable import check_file

SLOW, LOADING, RUNNING = 0x4138, 0x15, 0x2  # baud divisors: 9600, 142 857 and 1.5 M
HELLO, READY = b"\x0a\x43\x0d", b"\x0a\x44\x2c\x0d"
LETTER = b"\x41"
BLOCK = 62  # [bytes] sent between two echoes: a packet without its modem bytes
HELLOS = 100
ATTEMPTS = 10
LARGEST = 1 << 20  # [bytes] of an image, which has 14 to 100 kB
REPLY = 0.5  # [s] timeout for an answer


class RefusedError(Exception):
    """One attempt failed."""


def image(path: str) -> bytes:
    """The firmware in a file. DeviceError: missing or empty file."""
    try:
        check_file(Path(path).expanduser(), LARGEST)
        data = Path(path).expanduser().read_bytes()
    except OSError as error:
        raise DeviceError(
            f"firmware {path}: {error.strerror}. Give the image that came with your Falcon's driver, nvent_firmware.bin"
        ) from None
    if not data:
        raise DeviceError(f"firmware {path}: an empty file. Give the image that came with your Falcon's driver.")
    return data


def run_mode(chip: Ftdi) -> None:
    """Set the line up for a running firmware."""
    chip.control(ftdi.LATENCY, 1)
    chip.control(ftdi.BAUD, RUNNING)
    purge(chip)


def purge(chip: Ftdi) -> None:
    chip.control(ftdi.RESET, ftdi.PURGE_RX)
    chip.control(ftdi.RESET, ftdi.PURGE_TX)


def load(chip: Ftdi, data: bytes, now: Callable[[], int]) -> int:
    """Load an image; returns the number of attempts. `now`: a clock [ns].

    DeviceError: all attempts failed.
    """
    text = ""
    for attempt in range(1, ATTEMPTS + 1):
        try:
            _greet(chip, now)
            _send(chip, data, now)
            run_mode(chip)
            return attempt
        except RefusedError as error:
            text = str(error)
    raise DeviceError(
        f"the firmware could not be loaded in {ATTEMPTS} attempts: {text}. Switch the Falcon off for a moment,"
        " plug it into the machine itself without a hub, and try again."
    )


def _greet(chip: Ftdi, now: Callable[[], int]) -> None:
    purge(chip)
    for request, value in (
        (ftdi.LATENCY, 16),
        (ftdi.BAUD, SLOW),
        (ftdi.DATA, ftdi.BITS_8N1),
        (ftdi.FLOW, 0),
        (ftdi.MODEM, ftdi.RTS_LOW),
        (ftdi.MODEM, ftdi.DTR_LOW),
        (ftdi.MODEM, ftdi.DTR_HIGH),
    ):
        chip.control(request, value)
    for _ in range(HELLOS):
        chip.write(HELLO)
        if _take(chip, len(READY) + 1, 0.05, now, READY).endswith(READY):
            break
    else:
        raise RefusedError("it does not answer the greeting")
    chip.control(ftdi.MODEM, ftdi.DTR_LOW)
    chip.control(ftdi.BAUD, LOADING)
    chip.write(LETTER)
    if _take(chip, 1, REPLY, now) != LETTER:
        raise RefusedError("it does not answer at the loading speed")


def _send(chip: Ftdi, data: bytes, now: Callable[[], int]) -> None:
    for start in range(0, len(data), BLOCK):
        block = data[start : start + BLOCK]
        chip.write(block)
        echo = _take(chip, len(block), REPLY, now)
        if echo != block:
            raise RefusedError(
                f"the echo of the block at byte {start} is {'short' if len(echo) < len(block) else 'wrong'}"
            )


def _take(chip: Ftdi, count: int, patience: float, now: Callable[[], int], until: bytes = b"") -> bytes:
    """Read `count` bytes, or fewer if the timeout [s] expires or the bytes end with `until`."""
    answer, deadline = b"", now() + round(patience * 1e9)
    while len(answer) < count and now() < deadline and not (until and answer.endswith(until)):
        answer += payload(chip.read((deadline - now()) * 1e-9))
    return answer
