"""The messages of a recording, by stream."""

from palpate.messages import unpack


def read(recording, **kinds):
    """A list of messages for each keyword, the name of a node with `_` for `-`; its value is their type."""
    found = {name: [] for name in kinds}
    for name, _, payload in recording.payloads():
        if (key := name.replace("-", "_")) in kinds:
            found[key].append(unpack(payload, kinds[key]))
    return [found[name] for name in kinds]


def payloads(recording):
    """The encoded messages of each stream."""
    by_stream: dict[str, list[bytes]] = {}
    for name, _, payload in recording.payloads():
        by_stream.setdefault(name, []).append(payload)
    return by_stream
