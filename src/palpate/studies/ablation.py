"""Ablation: one recorded touch, computed again with each effect toggled."""

from collections.abc import Sequence

from palpate.launch.load.effect_costs import EffectCost
from palpate.records.compare import Variant
from palpate.records.reader import Recording
from palpate.studies.search import Show, compare_settings, relative_error

NONE = 1e-12  # [N] A smaller difference counts as no difference
RESOLUTION = 0.13  # [1] Relative width of a histogram bin of the step times


def ablate(
    recording: Recording, items: Sequence[EffectCost], overrides: Sequence[str] = (), show: Show = lambda effect: None
) -> None:
    """Record for each item how the force and the time of a tick change with the effect toggled.

    overrides  overrides of the plan of the items

    An effect that cannot be toggled gets the reason. RecordingError: the recording cannot be replayed.
    """
    for item in items:
        show(item.effect)
        if item.observed:
            item.proof = "no message depends on it"
            continue
        if not item.on and item.setting:
            item.proof = f"not tried: {item.where[0]} needs a value"
            continue
        both = compare_settings(
            recording, [*overrides, f"effects.{item.effect}={'off' if item.on else 'on'}"], overrides
        )
        if isinstance(both, str):
            why = both.splitlines()[0].split(": ", 1)[-1]
            item.proof = f"cannot be switched {'off' if item.on else 'on'}: {why}"
        else:
            item.proof = _change(item, *both)


def _change(item: EffectCost, base: Variant, variant: Variant) -> str:
    if not variant.force.count:
        return "no force is computed"
    now, then = base.whole.report()["p50"] * 1e6, variant.whole.report()["p50"] * 1e6
    if abs(then - now) < RESOLUTION * now:
        cost = f"same time per tick ({now:.0f} µs)"
    else:
        cost = f"a tick takes {then:.0f} µs instead of {now:.0f}"
    word = "without it" if item.on else "with it"
    if variant.force.peak <= NONE:
        return f"{word}: same force; {cost}"
    scale = variant.force.scale
    if scale <= 0.0:
        return f"{word}: up to {variant.force.peak:.2g} N, where there was no force; {cost}"
    peak = variant.force.peak / scale
    return f"{word}: force differs by {relative_error(variant):.2%} of its peak (RMS), {peak:.2%} at most; {cost}"
