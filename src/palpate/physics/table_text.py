"""The lines of a text file of an instrument: its encoding, and rows in quotation marks."""

import codecs
import re
from pathlib import Path

from palpate.physics.readable import MOST_TEXT, check_readable
from palpate.physics.table_books import matlab_lines, workbook_lines

NO_TEXT = "not a text file in UTF-8, UTF-16, Latin-1 or Shift-JIS"
CONTROL = re.compile(r"[\0-\x08\x0e-\x1f]")
QUOTED = re.compile(r'\s*"((?:[^"]|"")*[,;\t|](?:[^"]|"")*)"\s*')
BINARY = {
    b"PK\3\4": "a zip archive; unpack it", b"\xd0\xcf\x11\xe0": "a workbook (.xls); save it as .xlsx or CSV",
    b"\x1f\x8b": "compressed; save its table as CSV",
    b"\x89HDF": "a file in HDF5 (MATLAB 7.3); save its table as CSV, in MATLAB with writetable, or with save -v7",
    b"TDSm": "a file of LabVIEW (.tdms); save its table as CSV, in Excel with the TDM importer, or with the package "
    "npTDMS: TdmsFile.read(FILE).as_dataframe().to_csv(OUT)",
    b"\\*File list": "a file of an atomic force microscope (NanoScope); export its curve as ASCII",
    b"\\*Force file list": "a file of an atomic force microscope (NanoScope); export its curve as ASCII",
}  # fmt: skip
"""First bytes of files that are no text -> what they are and how to get their table."""
JAPANESE = re.compile(r"[\u3041-\u30fe\u4e00-\u9fff\uff01-\uff5e]")
LATIN = 0.5  # [1] Least share of ASCII of a text in UTF-16 without a byte order mark


def text_lines(path: str | Path) -> list[str]:
    """The lines of a text file, those that are a single cell in quotation marks without them; or of a workbook (.xlsx)
    or a file of MATLAB (.mat), with tabs.

    OSError, ValueError: it cannot be read, or is no text."""
    check_readable(path, MOST_TEXT)
    raw = Path(path).read_bytes().rstrip(b"\x1a")  # end of file in DOS
    if raw.startswith(b"PK\3\4") and b"xl/" in raw:
        return workbook_lines(path)
    if raw.startswith(b"MATLAB 5.0"):
        return matlab_lines(path)
    for begin, kind in BINARY.items():
        if raw.startswith(begin) and (b"\0" in raw or begin[1:2] in b"K\x8b"):
            raise ValueError(kind)
    text = _decoded(raw)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if CONTROL.search(text):
        at, found = next((n, mark) for n, line in enumerate(lines, 1) for mark in CONTROL.findall(line))
        raise ValueError(f"{NO_TEXT}: found the character {found!r} in row {at}; save its table as text")
    return [_unquoted(line) for line in lines]


def _decoded(raw: bytes) -> str:
    """The text of a file. ValueError: it has none of the encodings."""
    head = raw[:1000]
    if raw.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif head.count(0) > len(head) // 4:  # Latin letters in UTF-16 without a byte order mark, or no text
        encodings = ["utf-16-be" if head[:1] == b"\0" else "utf-16-le"]
    else:
        encodings = ["utf-8-sig", "cp932", "cp1252"]
    for encoding in encodings:
        try:
            text = raw.decode(encoding)
        except UnicodeDecodeError:
            continue
        if encoding == "cp932" and not _is_japanese(raw, text):
            continue
        if encoding.startswith("utf-16-") and sum(map(str.isascii, text)) < LATIN * len(text):
            break
        return text
    raise ValueError(f"{NO_TEXT}; save its table as text")


def _is_japanese(raw: bytes, text: str) -> bool:
    """Whether a file is Shift-JIS rather than Latin-1: two kana or common kanji, and no other characters but ASCII and
    half-width kana. The first byte of common ones is a control character in Latin-1."""
    found = JAPANESE.findall(text)
    other = [
        mark for mark in text if not mark.isascii() and not JAPANESE.match(mark) and not "\uff61" <= mark <= "\uff9f"
    ]
    first = sum(0x81 <= byte <= 0x9F for byte in raw)
    return len(found) > 1 and not set(other) - set("　μΩ°℃±") and first >= len(found)


def _unquoted(line: str) -> str:
    """A line without the quotation marks around it, if they enclose all of its cells: `"1,2,3"`."""
    match = QUOTED.fullmatch(line)
    return match[1].replace('""', '"') if match else line
