"""The messages of one stream of a recording, for sources that repeat it."""

from collections.abc import Iterator
from typing import TypeVar

from mcap.records import Channel

from palpate.messages import Message, MessageError, unpack
from palpate.nodes.base import SettingError
from palpate.records.format.mcap_file import Broken, messages, read_declarations, read_records

M = TypeVar("M", bound=Message)


def recorded(path: str, stream: str, kind: type[M]) -> Iterator[M]:
    """The messages of a stream in the order of the file, chunk by chunk, because a recording of hours may exceed the
    memory; of the truncated file of a killed run those before its end.

    SettingError: the file is damaged, or the stream is missing or of another type.
    """
    channel, some = None, False
    try:
        for chunk in read_records(path):
            if not isinstance(chunk, bytes):
                continue
            for each in read_declarations(chunk):
                if isinstance(each, Channel) and each.topic == stream:
                    channel = each.id
            for which, _, _, payload in messages(chunk):
                if which == channel:
                    some = True
                    yield unpack(payload, kind)
    except Broken as broken:
        if not broken.cut:
            cure = "`palpate export --to mcap` saves the rest"
            raise SettingError(f"setting 'path': {path}: {broken}; {cure}") from None
    except OSError as error:
        raise SettingError(f"setting 'path': {path}: {error.strerror}; expected a recording") from None
    except MessageError as error:
        raise SettingError(f"setting 'stream': {path}, stream {stream!r}: {error}") from None
    if not some:
        raise SettingError(f"setting 'stream': {path} has no messages of a stream {stream!r}")
