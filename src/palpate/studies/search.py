"""Evaluate settings of a graph on one recorded touch: shared by `palpate tune`, `rates` and `plan --ablate`.

The touch is recorded once with the graph as it is (`record_touch`); each choice of settings then computes it again in
parallel with a reference (`compare_settings`). The best choice is written as a launch file (`write`) and run: the hand
reacts to the force, so the touch changes, and the error is measured on the new touch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml

from palpate.launch.load.files import Override
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.run.execute import execute
from palpate.physics.archive import replace_text
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.records.compare import Variant, compare
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError

Show = Callable[[str], None]  # Called with the name of each finished stage


@dataclass(frozen=True)
class Evaluation:
    """Settings, with their error and time on a touch.

    overrides   as `--set` takes them, by name
    error       [1] RMS error of a quantity over the peak of the reference;  worst [1] peak error over the same
    p50, p99    [s] processor time per tick, independent of other programs;  mean [s] includes the effect of lower rates
    why         the reason if the settings failed
    slowest     slowest node and the p50 [s] of its steps, without the body and nodes that run in under 1 % of the ticks
    reference   [s] mean time per tick with the settings of the reference
    outputs     [1] error of the output of each effect (`rates`)
    wall        [s] p50 and p99 of the wall time per tick, which grows if other programs run
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
    outputs: tuple[float, ...] = ()
    wall: tuple[float, float] = (math.inf, math.inf)

    @property
    def texts(self) -> list[str]:
        """Overrides as `--set` takes them."""
        return [f"{key}={value}" for key, value in self.overrides.items()]

    @property
    def most(self) -> float:
        """[1] The largest of all errors."""
        return max((self.error, *self.outputs))

    def with_errors(self, base: Variant, variant: Variant, quantity: str = "force") -> Evaluation:
        """A copy with the times and the error of a quantity of this variant."""
        cpu, wall = variant.cpu.report(), variant.whole.report()
        worst = relative_error(variant, quantity, "peak")
        return replace(self, error=relative_error(variant, quantity), worst=worst, p50=cpu["p50"], p99=cpu["p99"],
                       mean=cpu["mean"], reference=base.cpu.report()["mean"],
                       wall=(wall["p50"], wall["p99"]))  # fmt: skip


@dataclass(frozen=True)
class SearchResult:
    """Result of a search.

    tried      all candidates
    predicted  the choice on the recorded touch;  measured in a run. None: no candidate meets the goal
    met        whether the run met the goal
    """

    tried: Sequence[Any]
    predicted: Evaluation | None = None
    measured: Evaluation | None = None
    met: bool = False


def read_error(text: str, quantities: Sequence[str] = ()) -> tuple[float, str]:
    """Share [1] and quantity of '2 % force'; of '1 %' if there are no quantities. ArgumentError: another form."""
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


def relative_error(variant: Variant, quantity: str = "force", measure: str = "rms") -> float:
    """[1] RMS or peak error of a quantity over the peak of the reference; 0 if the reference has no peak."""
    spread = getattr(variant, quantity).report()
    return spread[measure] / spread["reference_peak"] if spread["reference_peak"] > 0.0 else 0.0


def compare_settings(
    recording: Recording, texts: Sequence[str], reference: Sequence[str]
) -> tuple[Variant, Variant] | str:
    """The touch with the settings of the reference and with these; the reason if these cannot compute it.

    RecordingError: the recording cannot be replayed.
    """
    try:
        base, variant = compare(recording, [texts], reference=reference)
    except RecordingError:
        raise
    except PalpateError as error:
        return str(error)
    return base, variant


def record_touch(launch: LaunchFile, file: Path) -> Recording:
    """Run the graph in this process and record it. ArgumentError: it is endless, fails, or drives a real device."""
    name, graph = launch.path or launch.graph, launch.load()
    if launch.duration is None:
        raise ArgumentError(f"{name}: the run has no end; set the length of the touch: --duration '5 s'")
    devices = [node for node, spec in graph.nodes.items() if spec.cls.hardware]
    if devices:
        raise ArgumentError(
            f"{name}: node {devices[0]!r} drives a device, but the touch is computed many times; expected a simulated "
            f"device: --set {devices[0]}.use=device.Simulated, or the graph kidney"
        )
    outcome = execute(replace(launch, record=file, place=FUSED, clock="simulated"))
    outcome.raise_signal()
    if not outcome.result.ok:
        raise ArgumentError(f"{name}: the run of the touch failed: {outcome.result.deaths[0]}")
    return Recording(file)


def _entry(override: str | Override) -> tuple[str, Any]:
    """Path and value of an override, also of a launch file or of an organ."""
    if isinstance(override, str):
        path, _, value = override.partition("=")
        return path.strip(), yaml.safe_load(value)
    return ".".join(override.keys), override.value.data


def write(launch: LaunchFile, chosen: dict[str, Any], comments: Sequence[str], path: Path) -> None:
    """Write the launch file of the choice, with these comments at its head."""
    content: dict[str, Any] = {"graph": str(launch.graph.resolve())}
    if launch.scene is not None:
        content["scene"] = str(launch.scene.resolve()) if isinstance(launch.scene, Path) else launch.scene
    content |= {name: getattr(launch, name) for name in ("clock", "duration") if getattr(launch, name) is not None}
    content["set"] = dict(_entry(override) for override in launch.overrides) | chosen
    head = "".join(f"# {line}\n" for line in comments)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_text(path, head + yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
