"""The lines of a text file of an instrument: its encoding, and rows in quotation marks."""

import codecs
import re
from pathlib import Path

from palpate.physics.readable import MOST_TEXT, check_readable

CONTROL = re.compile(r"[\0-\x08\x0e-\x1f]")
QUOTED = re.compile(r'\s*"((?:[^"]|"")*[,;\t|](?:[^"]|"")*)"\s*')
BINARY = {
    b"PK\3\4": "a zip archive or workbook (.xlsx)", b"\xd0\xcf\x11\xe0": "a workbook (.xls)", b"\x1f\x8b": "compressed",
    b"MATLAB": "a file of MATLAB (.mat)", b"TDSm": "a file of LabVIEW (.tdms)", b"\x89HDF": "a file in HDF5",
}  # fmt: skip
"""First bytes of files that are no text."""


def text_lines(path: str | Path) -> list[str]:
    """The lines of a text file; those that are a single cell in quotation marks without them.

    OSError, ValueError: it cannot be read, or is no text."""
    check_readable(path, MOST_TEXT)
    raw = Path(path).read_bytes().rstrip(b"\x1a")  # end of file in DOS
    for begin, kind in BINARY.items():
        if raw.startswith(begin) and (b"\0" in raw[:1000] or begin[1:2] in b"K\x8b"):
            raise ValueError(f"{kind}; save its table as CSV")
    head = raw[:1000]
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif head.count(0) > len(head) // 4:  # Latin letters in UTF-16 without a byte order mark
        encodings = ["utf-16-be" if head[:1] == b"\0" else "utf-16-le"]
    else:
        encodings = ["utf-8-sig", "cp1252"]
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        if not CONTROL.search(text):
            return [_unquoted(line) for line in lines]
        at, found = next((n, mark) for n, line in enumerate(lines, 1) for mark in CONTROL.findall(line))
        raise ValueError(f"not a text file in UTF-8, UTF-16 or Latin-1: found the character {found!r} in row {at}")
    raise ValueError("not a text file in UTF-8, UTF-16 or Latin-1")


def _unquoted(line: str) -> str:
    """A line without the quotation marks around it, if they enclose all of its cells: `"1,2,3"`."""
    match = QUOTED.fullmatch(line)
    return match[1].replace('""', '"') if match else line
