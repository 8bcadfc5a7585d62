"""Text of files, devices and other programs as it is printed: a terminal would obey its control characters, for example
write to its clipboard or overwrite earlier lines."""

CONTROLS = {code: chr(0x2400 + code) if code < 0x20 else "\N{REPLACEMENT CHARACTER}" for code in (
    *range(0x20), *range(0x7F, 0xA0)) if chr(code) not in "\t\n\r"}  # fmt: skip
"""Control characters and their replacements, without the white space."""
LONGEST = 2000  # characters of a line of another machine


def printable(text: str) -> str:
    """The text with symbols in place of control characters other than white space."""
    return text.translate(CONTROLS)


def one_line(text: str) -> str:
    """The text of another machine as one printable line of at most `LONGEST` characters."""
    line = printable(" ".join(text.split()))
    return line if len(line) <= LONGEST else f"{line[:LONGEST]}..."


def lines_of(text: str) -> str:
    """The text of another machine as printable lines: white space other than the ends of lines becomes a blank."""
    return printable("\n".join(line.expandtabs(4).replace("\r", " ") for line in text.split("\n")))
