"""Runs a graph in every way in one process, after numpy was used and a custom function was compiled.

    python same_bytes.py GRAPH NODES FOLDER

Prints a digest of each stream for each way of running. NODES is a JSON list of variants: overrides of nodes.
"""

import hashlib
import json
import sys
from pathlib import Path

import numba
import numpy as np
import scipy.linalg


@numba.njit
def total(x):
    """A custom function, which numba compiles for this processor."""
    return np.sum(np.exp(x)) + np.dot(x, x)


if __name__ == "__main__":  # before palpate is imported; a test that imports this file compiles nothing
    assert total(np.ones(300)) > 0.0 and scipy.linalg.inv(np.eye(40) + 0.1).any()


def digests(file):
    """Digests of the bytes of each stream of a recording."""
    from mcap.reader import make_reader

    streams = {}
    with open(file, "rb") as opened:
        for _, channel, message in make_reader(opened).iter_messages():
            streams.setdefault(channel.topic, hashlib.sha256()).update(message.data)
    return {name: one.hexdigest()[:16] for name, one in sorted(streams.items())}


def environment(graph, nodes):
    from palpate.gym.touch import Touch

    env, seen = Touch(graph, duration=1.0, nodes=nodes), hashlib.sha256()
    for part in env.reset(seed=3)[0].values():
        seen.update(part.tobytes())
    for turn in range(12):
        observation = env.step(np.array([0.01, 0.0, -0.03 if turn < 9 else 0.02], np.float32))[0]
        assert env.tick is not None
        seen.update(repr(env.tick.contact.force).encode())
        for part in observation.values():
            seen.update(part.tobytes())
    env.close()
    return seen.hexdigest()[:16]


def main(graph, variants, folder):
    import palpate

    printed = []
    for number, nodes in enumerate(json.loads(variants)):
        file = Path(folder) / f"{number}.mcap"
        run = palpate.run(graph, record=file, duration=0.12, **nodes)
        steps = hashlib.sha256()
        for tick in palpate.steps(graph, duration=0.12, **nodes):
            steps.update(repr((tick.contact, tick.controller)).encode())
        printed.append(
            [digests(file), steps.hexdigest()[:16], environment(graph, nodes), float(run.contact.force.max())]
        )
    print(json.dumps(printed))


if __name__ == "__main__":
    main(*sys.argv[1:])
