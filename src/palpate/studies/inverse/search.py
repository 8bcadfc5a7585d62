"""Random touches, whose settings `fit_run` should find: how often its intervals contain the true values.

A touch presses and strokes the kidney with a random body, depth, speed and encoder. Its force and friction are computed
with random true settings, and get random noise. The fit begins at the settings of the scene.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.gradients.parameters import find_parameter
from palpate.launch.load.arguments import describe_run
from palpate.physics.scratch import ScratchFolder
from palpate.studies.inverse.fit import fit_run
from palpate.studies.inverse.forward import Forward
from palpate.studies.inverse.measured import Measured, driven
from palpate.studies.inverse.motions import Motion
from palpate.studies.kept import adding_lines, kept_lines

BODIES = {
    "MassSpring": ("tissue.stiffness", "tissue.retardation"),
    "ReducedFE": ("tissue.young", "tissue.retardation"),
    "BeamBundle": ("tissue.moduli[0]", "tissue.moduli[1]"),
}
"""Bodies, and the settings of each that are free."""
SHARED = ("friction.mu_slide", "contact.finger_hardening")
FIELDS = ["contact.force", "friction.force"]
NOISES = ("white", "correlated", "quantised")
GOAL = (0.92, 0.98)
FAR = 3.0  # [1] Half-widths of an interval by which no value may be wrong without a word
COUNT = 60e-6  # [m] of the encoder
KEPT = "runs.jsonl"


@dataclass(frozen=True)
class RunOutcome:
    """The fit of a touch.

    results  by setting: inside, missed, or open (not determined)
    apart    [1] by setting, the error over the half-width of the interval on its side
    seconds  [s] of processor time, and the number of runs
    """

    number: int
    seed: int
    body: str
    noise: str
    size: float
    results: dict[str, str]
    apart: dict[str, float]
    seconds: float
    runs: int
    notes: list[str]

    @property
    def silent(self) -> bool:
        """Whether a value that counts as determined is wrong by more than `FAR` intervals."""
        return any(result == "missed" and self.apart[name] > FAR for name, result in self.results.items())


def judge(seed: int, number: int) -> RunOutcome:
    """Draw, fit and judge a touch."""
    rng = np.random.default_rng([seed, number])
    body, noise = list(BODIES)[number % len(BODIES)], NOISES[number // len(BODIES) % len(NOISES)]
    measured, truth, size = _draw_touch(rng, body, noise)
    begun = time.process_time()
    fit = fit_run([measured], list(truth))
    took = time.process_time() - begun
    results, apart = {}, {}
    for name, true in truth.items():
        at = fit.estimate.intervals[name]
        end = at.high if true > at.value else at.low
        apart[name] = abs(true - at.value) / max(abs(end - at.value), 1e-300)
        results[name] = "open" if name in fit.open_ else "inside" if at.low <= true <= at.high else "missed"
    return RunOutcome(number, seed, body, noise, size, results, apart, took, fit.runs, fit.notes)


def _draw_touch(rng: np.random.Generator, body: str, noise: str) -> tuple[Measured, dict[str, float], float]:
    """A touch with its noisy fields, the true settings, and the size of the noise over the peak."""
    launch = describe_run("kidney", scene=None, duration=None, sets=[f"tissue.use=deformation.{body}"], nodes={})
    motion, folder = _motion(rng), ScratchFolder("bench-fits")
    file = Path(folder.name) / "touch.csv"
    np.savetxt(file, motion, delimiter=",", header="t,x,y,z", comments="", fmt="%.12g")
    run = driven(launch, {"finger": (file, "finger")}, FIELDS)
    ticks, rate = len(motion), 1000.0
    rows, graph = np.arange(ticks), run.load()
    measured = Measured("touch", run.but(duration=ticks / rate), FIELDS, [], rows, ticks, rate,
                        {"finger": motion[:, 1:]}, launch, None, folder)  # fmt: skip
    free = [*BODIES[body], *SHARED]
    parameters = [find_parameter(graph, path, graph.nodes) for path in free]
    truth = [each.value * math.exp(rng.uniform(-0.6, 0.6)) for each in parameters]
    forward = Forward(measured, parameters)
    try:
        fields = [values[0] for values in forward(np.array([truth]))]
    finally:
        forward.close()
    size = 10.0 ** rng.uniform(-3.0, -1.7)
    peak = float(np.abs(fields[0]).max())
    measured.values = [_with_noise(rng, values, noise, size * peak) for values in fields]
    return measured, dict(zip(free, truth, strict=True)), size


def _motion(rng: np.random.Generator) -> Motion:
    """A press, a hold and a stroke near the top of the kidney, at 1 kHz, with or without counts of an encoder."""
    depth, length = rng.uniform(4e-3, 9e-3), rng.uniform(5e-3, 15e-3)  # [m]
    press, hold, stroke = rng.uniform(0.1, 0.4), rng.uniform(0.05, 0.2), rng.uniform(0.1, 0.4)  # [s]
    begin = np.array([rng.uniform(-5e-3, 5e-3), 0.0, 0.1105])
    ends = np.cumsum([press, hold, stroke, press])
    down, side = np.array([0.0, 0.0, -depth]), np.array([length, 0.0, 0.0])
    points = np.array([begin, begin + down, begin + down, begin + down + side, begin + side])
    t = np.arange(round(ends[-1] * 1e3)) / 1e3
    share, knots = np.empty((len(t), 3)), np.concatenate([[0.0], ends])
    for k in range(4):
        inside = (t >= knots[k]) & (t <= knots[k + 1])
        s = (t[inside] - knots[k]) / (knots[k + 1] - knots[k])
        share[inside] = points[k] + (10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5)[:, None] * (points[k + 1] - points[k])
    if rng.random() < 0.5:
        share = np.round(share / COUNT) * COUNT
    return np.column_stack([t, share])


def _with_noise(rng: np.random.Generator, values: np.ndarray, noise: str, size: float) -> np.ndarray:
    """Values (rows, k) with noise of this size [their unit]: white, autoregressive, or of a converter."""
    white = rng.standard_normal(values.shape)
    if noise == "white":
        return values + size * white
    if noise == "correlated":
        rho = 0.9
        for i in range(1, len(white)):
            white[i] = rho * white[i - 1] + math.sqrt(1.0 - rho**2) * white[i]
        return values + size * white
    step = size * math.sqrt(12.0)
    return np.round((values + 0.2 * step * white) / step) * step


def search(
    count: int, seed: int, out: Path, show: Callable[[float, str], object], first: int = 0
) -> Iterator[RunOutcome]:
    """Touches first ... first + count - 1, one after the other; those in the folder are not fitted again."""
    out.mkdir(parents=True, exist_ok=True)
    known: dict[int, RunOutcome] = {}
    for line in kept_lines(out / KEPT):
        with suppress(TypeError):
            outcome = RunOutcome(**line)
            if outcome.seed == seed:
                known[outcome.number] = outcome
    missed = 0
    with adding_lines(out / KEPT) as add:
        for number in range(first, first + count):
            outcome = known.get(number) or judge(seed, number)
            if number not in known:
                add(asdict(outcome))
            missed += "missed" in outcome.results.values()
            show((number - first + 1) / count, f"{missed} with a missed setting")
            yield outcome


def summary(found: Sequence[RunOutcome]) -> dict[str, Any]:
    """Counts by body and by noise, and whether nothing is silently wrong."""
    rows = []
    groups = {"all": list(found)}
    groups |= {each: [o for o in found if o.body == each] for each in BODIES}
    groups |= {f"noise: {each}": [o for o in found if o.noise == each] for each in NOISES}
    for name, part in groups.items():
        results = [result for outcome in part for result in outcome.results.values()]
        if not results:
            continue
        inside, missed = results.count("inside"), results.count("missed")
        rows.append({
            "stratum": name, "touches": len(part), "settings": len(results), "inside": inside, "missed": missed,
            "open": results.count("open"), "coverage": inside / max(inside + missed, 1),
            "apart": max(max(o.apart.values()) for o in part), "silent": sum(o.silent for o in part),
            "seconds": float(np.median([o.seconds for o in part])), "runs": float(np.median([o.runs for o in part])),
        })  # fmt: skip
    return {"ok": not any(o.silent for o in found), "touches": len(found), "rows": rows}


def text(found: Sequence[RunOutcome]) -> str:
    """The table of all strata."""
    low, high = (100 * share for share in GOAL)
    lines = [
        f"{len(found)} random touches, 4 free settings each. coverage: true values in their intervals of 95 %",
        f"(goal {low:g} to {high:g} %); open: not determined; apart: error over half of the interval, at worst;",
        f"silent: apart by more than {FAR:g}; seconds of processor time and runs of a fit, medians.", "",
        f"{'stratum':22}{'touches':>8}{'inside':>8}{'missed':>8}{'open':>6}{'coverage':>10}{'apart':>7}{'silent':>8}"
        f"{'seconds':>9}{'runs':>6}",
    ]  # fmt: skip
    for r in summary(found)["rows"]:
        lines.append(
            f"{r['stratum']:22}{r['touches']:>8}{r['inside']:>8}{r['missed']:>8}{r['open']:>6}"
            f"{100 * r['coverage']:>9.1f}%{r['apart']:>7.3g}{r['silent']:>8}{r['seconds']:>9.2f}{r['runs']:>6.0f}"
        )
    return "\n".join(lines) + "\n"
