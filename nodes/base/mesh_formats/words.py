"""Words of a text file as numbers, in memory that grows with the file, however long one of its words is."""

from collections.abc import Sequence

import numpy as np


def numbers(words: Sequence[bytes]) -> np.ndarray:
    """Words as float64 (n). ValueError: one of them is no number; see `wrong_word`."""
    return np.fromiter(map(float, words), np.float64, len(words))


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


def plain_lines(data: bytes) -> list[bytes]:
    """Lines of a text: of any system (LF, CR LF, CR), without a byte order mark."""
    return data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n").split(b"\n")
