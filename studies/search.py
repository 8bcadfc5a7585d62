"""Settings of a graph tried on one recorded touch: what `palpate tune`, `rates` and `plan --ablate` have in common.

The touch is recorded once as the graph stands (`touched`), and each choice computes it again next to a reference
(`compared`). A choice is written as a launch file (`write`) and run: the hand reacts to the force, so that the touch
becomes another one, and what came is measured on that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.run.execute import execute
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.records.compare import Variant, compare
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

Show = Callable[[str], None]  # Called with the name of what was done


@dataclass(frozen=True)
class Trial:
    """Settings, and what they gave on a touch.

    overrides  as `--set` takes them, by name
    error      [1] rms of a quantity from that of the reference, over its peak;  worst [1] its greatest, over its peak
    p50, p99   [s] processor time of a tick, which other programs do not change;  mean [s] too, as a rate that is lower
               does not show in the median
    why        what went wrong, if something did
    slowest    the node beside the body that takes longest of those that run in at least one tick of a hundred, and the
               p50 [s] of its steps
    reference  [s] mean of a tick with the settings of the reference
    own        [1] error of the output of each effect (`rates`)
    wall       [s] p50 and p99 of a tick by the clock: longer than processor time where other programs run
    """

    overrides: dict[str, Any]
    error: float = math.inf
    p50: float = math.inf
    p99: float = math.inf
    why: str = ""
    slowest: tuple[str, float] = ("", 0.0)
    mean: float = math.inf
    reference: float = math.inf
    worst: float = math.inf
    own: tuple[float, ...] = ()
    wall: tuple[float, float] = (math.inf, math.inf)

    @property
    def texts(self) -> list[str]:
        """Overrides as `--set` takes them."""
        return [f"{key}={value}" for key, value in self.overrides.items()]

    @property
    def most(self) -> float:
        """[1] The greatest of all its errors."""
        return max((self.error, *self.own))

    def measured(self, base: Variant, variant: Variant, quantity: str = "force") -> Trial:
        """With the error of a quantity and the times of what it gave."""
        cpu, wall = variant.cpu.report(), variant.whole.report()
        worst = off_by(variant, quantity, "peak")
        return replace(self, error=off_by(variant, quantity), worst=worst, p50=cpu["p50"], p99=cpu["p99"],
                       mean=cpu["mean"], reference=base.cpu.report()["mean"],
                       wall=(wall["p50"], wall["p99"]))  # fmt: skip


@dataclass(frozen=True)
class Found:
    """What a search ended with: all that was tried, what was promised on the touch and came in a run of it (None:
    nothing keeps what is asked for), and whether the run kept it."""

    tried: Sequence[Any]
    promised: Trial | None = None
    came: Trial | None = None
    kept: bool = False


def read_error(text: str, quantities: Sequence[str] = ()) -> tuple[float, str]:
    """Share [1] and quantity of '2 % force'; without quantities to choose from, of '1 %'. ArgumentError: it is none."""
    number, sign, rest = text.partition("%")
    quantity = rest.strip() or "force"
    try:
        share = float(number) / 100.0
    except ValueError:
        share = math.nan
    if not 0.0 < share < 1.0 or not sign or quantity not in (quantities or ("force",)) or (rest and not quantities):
        example = f"'2 % force'; of {', '.join(quantities)}" if quantities else "'1 %'"
        raise ArgumentError(
            f"error: found {text!r}, expected a share of a peak, above 0 and below 100, such as {example}"
        )
    return share, quantity


def off_by(variant: Variant, quantity: str = "force", measure: str = "rms") -> float:
    """[1] By what a quantity is off, rms (or peak) over the peak of the reference; 0 where the reference has none."""
    spread = getattr(variant, quantity).report()
    return spread[measure] / spread["reference_peak"] if spread["reference_peak"] > 0.0 else 0.0


def compared(
    recording: Recording, texts: Sequence[str], reference: Sequence[str]
) -> tuple[Variant, Variant] | str:  # fmt: skip
    """The touch with the settings of the reference and with these; or why it cannot be computed with them.

    RecordingError: it is no touch that can be computed again.
    """
    try:
        base, variant = compare(recording, [texts], reference=reference)
    except RecordingError:
        raise
    except PalpateError as error:
        return str(error)
    return base, variant


def touched(launch: LaunchFile, file: Path) -> Recording:
    """One run of the graph, in this process, recorded. ArgumentError: it has no end, it failed, or it would move a
    device."""
    name, graph = launch.path or launch.graph, launch.load()
    if launch.duration is None:
        raise ArgumentError(f"{name}: it runs without end; give the length of the touch: --duration '5 s'")
    devices = [node for node, spec in graph.nodes.items() if spec.cls.hardware]
    if devices:
        raise ArgumentError(
            f"{name}: node {devices[0]!r} drives a device, and the touch is computed many times here; expected a "
            f"simulated one: --set {devices[0]}.use=device.Simulated, or the graph kidney"
        )
    outcome = execute(replace(launch, record=file, place=FUSED, clock="simulated"))
    outcome.signalled()
    if not outcome.result.ok:
        raise ArgumentError(f"{name}: the run of the touch failed: {outcome.result.deaths[0]}")
    return Recording(file)


def write(launch: LaunchFile, chosen: dict[str, Any], told: Sequence[str], path: Path) -> None:
    """A launch file of the choice, its reasons as comments at its head."""
    content: dict[str, Any] = {"graph": str(launch.graph.resolve())}
    if launch.scene is not None:
        content["scene"] = str(launch.scene.resolve()) if isinstance(launch.scene, Path) else launch.scene
    content |= {name: getattr(launch, name) for name in ("clock", "duration") if getattr(launch, name) is not None}
    own = [text.partition("=") for text in launch.overrides if isinstance(text, str)]
    content["set"] = {key: yaml.safe_load(value) for key, _, value in own} | chosen
    head = "".join(f"# {line}\n" for line in told)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
