"""Files that are no text: named by their first bytes; compressed ones are not unpacked beyond their limit."""

import re
import struct
import zlib

import numpy as np
import pytest
from scipy.io import savemat

from palpate.physics.claims import largest_content
from palpate.physics.table_text import BINARY, text_lines


@pytest.mark.parametrize("begin", BINARY)
@pytest.mark.parametrize("rest", [b"\0" * 100, b"\x01\x02" * 50])
def test_a_file_that_is_no_text_is_named_by_its_first_bytes(tmp_path, begin, rest):
    """A zip archive and gzip also without a zero; the other names could begin a text."""
    (tmp_path / "a").write_bytes(begin + rest)
    named = b"\0" in rest or begin[1:2] in b"K\x8b"
    with pytest.raises(ValueError, match=re.escape(BINARY[begin]) if named else "."):
        text_lines(tmp_path / "a")


def test_a_text_may_begin_like_the_file_of_an_instrument(tmp_path):
    (tmp_path / "a").write_text("TDSm,force\n1,2\n")
    assert text_lines(tmp_path / "a")[0] == "TDSm,force"


@pytest.mark.parametrize("head", ["déplacement;réaction", "Prüfkörper größer;Längenänderung", "élévation,épaisseur"])
def test_accents_of_latin_1_are_not_read_as_kanji(tmp_path, head):
    """Each of these letters and the next one are two bytes that Shift-JIS reads as a kanji or kana."""
    (tmp_path / "a").write_bytes(f"{head}\n1;2\n".encode("latin-1"))
    assert text_lines(tmp_path / "a")[0] == head


def test_a_japanese_head_is_read(tmp_path):
    (tmp_path / "a").write_bytes("変位,荷重\n1,2\n".encode("cp932"))
    assert text_lines(tmp_path / "a")[0] == "変位,荷重"


def test_a_file_of_matlab_that_unpacks_beyond_its_limit_is_refused(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"force": np.arange(5.0)}, do_compression=True)
    head = path.read_bytes()
    assert text_lines(path)[0] == "force"
    squeezed = zlib.compressobj(9)
    size, zeros = 0, bytes(1 << 24)
    packed = b""
    while size <= largest_content(len(head) + len(packed) + 1000):
        packed += squeezed.compress(zeros)
        size += len(zeros)
    packed += squeezed.flush()
    path.write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(ValueError, match="its compressed content claims"):
        text_lines(path)
