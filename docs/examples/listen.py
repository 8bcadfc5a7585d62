"""Read a stream of a running graph with only pyzmq and msgpack (pip install pyzmq msgpack).

python listen.py contact          # until Ctrl-C
python listen.py contact 10       # ten messages
"""

import os
import struct
import sys
from pathlib import Path

import msgpack
import zmq


def outlets():
    """Addresses at which this user's runs on this machine publish."""
    folders = (Path(os.environ.get("XDG_RUNTIME_DIR", "/nowhere")) / "palpate", Path(f"/tmp/palpate-{os.getuid()}"))
    return [f"ipc://{path}" for folder in folders for path in folder.glob("*/*.observers")]


def array(value):
    """Decode a large array, sent as {dtype, shape, data}, to a flat tuple of numbers."""
    code = {"<f8": "d", "<f4": "f", "<i4": "i", "<i8": "q"}[value["dtype"]]
    return struct.unpack(f"<{len(value['data']) // struct.calcsize(code)}{code}", value["data"])


def listen(stream, count):
    socket = zmq.Context.instance().socket(zmq.SUB)
    socket.subscribe(stream.encode() + b"\0")  # without the zero byte `contact` would also match `contact-2`
    addresses = outlets()
    if not addresses:
        sys.exit("no run is active; start one: palpate run kidney --clock real")
    for address in addresses:
        socket.connect(address)
    while count != 0:
        topic, _, payload = socket.recv().partition(b"\0")
        message = msgpack.unpackb(payload)
        values = {
            name: array(value) if isinstance(value, dict) else value
            for name, value in message.items()
            if name not in ("source", "used")
        }
        print(topic.decode(), values, flush=True)
        count -= 1


if __name__ == "__main__":
    listen(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else -1)
