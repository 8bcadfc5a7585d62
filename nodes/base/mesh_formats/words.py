"""Words of a text file as numbers, in memory that grows with the file, however long one of its words is."""

import re
from codecs import BOM_UTF8, BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence

import numpy as np

_UNDEFINED = re.compile(rb"[+-]?(1[.,]#\w+|nan\(\w*\))", re.IGNORECASE)


def numbers(words: Sequence[bytes]) -> np.ndarray:
    """Words as float64 (n). ValueError: one of them is no number; see `wrong_word`."""
    return np.fromiter(map(float, words), np.float64, len(words))


def numbers_or_nan(words: Sequence[bytes]) -> np.ndarray:
    """As `numbers`; NaN for what the C library of Windows prints for an undefined number: `-1.#IND`, `-nan(ind)`."""
    try:
        return numbers(words)
    except ValueError:
        return numbers([b"nan" if _UNDEFINED.fullmatch(word) else word for word in words])


def integers(words: Sequence[bytes]) -> np.ndarray:
    """Words as int64 (n). ValueError: one of them is no integer of 64 bits; see `wrong_word`."""
    try:
        return np.fromiter(map(int, words), np.int64, len(words))
    except OverflowError as error:
        raise ValueError(str(error)) from None


def wrong_word(words: Sequence[bytes], kind: type) -> str:
    """The first word that is not of this kind (int or float), shortened, in quotation marks; "" if all are."""
    for word in words:
        try:
            if abs(kind(word)) >= 1 << 63 and kind is int:
                return shown(word)
        except ValueError:
            return shown(word)
    return ""


def shown(word: bytes) -> str:
    """A part of a file as it is quoted in a message."""
    text = word.decode(errors="replace").strip()
    return repr(text if len(text) <= 60 else text[:57] + "...")


def without_mark(data: bytes) -> bytes:
    """A text in UTF-8 without the byte order mark with which it begins, also of UTF-16; other bytes as they are."""
    if data.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        try:
            return data.decode("utf-16").encode()
        except UnicodeError:
            return data
    return data.removeprefix(BOM_UTF8)


def plain_lines(data: bytes) -> list[bytes]:
    """Lines of a text of any system: LF, CR LF, CR."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
