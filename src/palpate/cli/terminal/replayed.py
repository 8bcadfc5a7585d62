"""Output of a replay and of the check of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, say, table

if TYPE_CHECKING:
    from palpate.records.differences import Report
    from palpate.records.reader import Recording
    from palpate.records.replay import Replay


def print_check(recording: Recording, report: Report, tolerance: float, elsewhere: list[str]) -> None:
    """Print the result of a check; elsewhere: versions or instructions that differ from those of the recording."""
    count = sum(node.checked for node in report.nodes.values())
    if report.first is not None:
        say(f"first difference: {report.first}", "red")
        for name, node in report.nodes.items():
            if node.differing:
                say(f"  {name}: {node.differing} of {node.checked} messages differ, by {node.largest:.2g} at most")
    elif count:
        how = f"equal within {tolerance:g}" if tolerance else "bit-equal"
        say(f"{count} messages of {len(report.nodes)} nodes computed again: {how}", "green")
    else:
        say("no message could be checked", "red")
    if elsewhere:
        how = f"numbers are compared within {tolerance:g}" if tolerance else "bytes are compared nevertheless"
        say(f"Computed with other versions or instructions: {'; '.join(elsewhere)}; {how}.", "yellow")
    for name, node in report.nodes.items():
        if node.stopped:
            say(f"not checked: {name}: {node.stopped}", "yellow")
        elif node.gap:
            say(f"checked but for a gap: {name}: {node.gap}", "yellow")
    if not report.verified and report.first is None:
        until = "nothing was verified as a whole" if report.until is None else f"verified: 0 to {report.until:.3f} s"
        say(f"not the whole run: {until}", "red")
    if report.cut:
        ending = recording.ending or f"{recording.path} was recovered"
        say(f"{ending} The last messages may lack some of their inputs.", "yellow")


def as_data(player: Replay) -> dict[str, Any]:
    return {
        "ok": True,
        "complete": player.recording.complete,
        "ending": player.recording.ending,
        "seconds": player.seconds,
        "wall": player.wall,
        "notes": player.notes,
        "substituted": player.player.substituted if player.player else 0,
        "nodes": {
            name: {"messages": r.checked, "differing": r.differing, "largest": r.largest}
            for name, r in player.reports.items()
        },
    }


def summary(player: Replay) -> None:
    times = f", {player.seconds / player.wall:.2f} x real time" if player.wall > 0 else ""
    say(f"{player.seconds:.3f} s replayed in {player.wall:.2f} s{times}", wrap=True)
    rows = (
        (name, str(one.checked), str(one.differing), f"{100 * one.largest:.2g}" if one.differing else "")
        for name, one in player.reports.items()
    )
    console().print(
        table(("node that ran", ">messages", ">other than recorded", ">largest difference\n[% of peak]"), rows)
    )
    if player.player and player.player.substituted:
        say(f"{player.player.substituted} lost inputs were replaced by the previous ones", "yellow", wrap=True)
    for note in player.notes:
        say(note, "yellow", wrap=True)
    if not player.recording.complete:
        say(player.recording.ending, "yellow")
