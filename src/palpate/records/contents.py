"""The contents of a recording as plain data."""

from typing import Any

from palpate.records.stored import Stored


def contents(recording: Stored) -> dict[str, Any]:
    """Streams with counts, rates and losses; duration, origin and truncation."""
    counts = dict.fromkeys(recording.streams, 0)
    sizes = dict.fromkeys(recording.streams, 0)
    first: dict[str, int] = {}
    last: dict[str, int] = {}
    for name, _, time, payload in recording.raw():
        counts[name] += 1
        sizes[name] += len(payload)
        first.setdefault(name, time)
        last[name] = time
    about = recording.about
    begin, end = min(first.values(), default=0), max(last.values(), default=0)
    streams = []
    for name, stream in recording.streams.items():
        span = (last.get(name, 0) - first.get(name, 0)) * 1e-9
        streams.append({
            "name": name, "type": stream.schema["title"], "node": stream.producer, "every": stream.every,
            "thin": stream.thin, "count": counts[name], "lost": recording.counts.get(name, {}).get("lost"),
            "rate": (counts[name] - 1) / span if span > 0 and counts[name] > 1 else None, "bytes": sizes[name],
        })  # fmt: skip
    plan = about.get("plan", {})
    known = {s for node in plan.get("order", ()) for s in plan.get("wanted", {}) if s.partition(".")[0] == node}
    return {
        "file": str(recording.path),
        "size": recording.path.stat().st_size,
        "complete": recording.complete,
        "ending": recording.ending,
        "duration": (end - begin) * 1e-9,
        "graph": plan.get("path"),
        "rate": plan.get("rate"),
        **{key: about.get(key) for key in ("clock", "date", "commit", "versions", "machine", "arithmetic")},
        "restarted": recording.restarted,
        "notes": [{"text": text, "node": node, "time": time} for text, node, time in recording.notes],
        "files": [
            {"name": name, "differs": recording.wrong.get(name), "copy": recording.moved.get(name)}
            for name in recording.files
        ],
        "left_out": sorted(known - set(recording.streams)),
        "streams": streams,
    }
