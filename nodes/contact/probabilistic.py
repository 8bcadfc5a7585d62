"""The contact force as a random variable: mean and deviation of a measured subject's finger at this indentation."""

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import yaml

from palpate.messages import Contact, ForceBand, Vector
from palpate.nodes.base import Node, SettingError, Wants, part
from palpate.physics.contact.force_band import PUBLISHED, Band, band_at, truncated_quantile, uniform
from palpate.physics.contact.force_models import MODELS
from palpate.physics.readable import MOST_TEXT, check_readable

LAW_SETTINGS = ("mean", "mean_parameters", "deviation", "deviation_parameters", "depth_limit", "freedom")
"""The settings that a fit determines, in the order of `Band`; a file may omit the last one."""


class MeasuredSubject(Node):
    """Settings of a measured subject's force, and its band at an indentation, for the nodes that compute it.

    The laws are fitted to measured sessions. The default is the published subject; `palpate fit force` writes those of
    other subjects to a file: `model` is its path, and `subject` selects one of several subjects. The node copies the
    settings of the file when it is made, so that a recording contains them.

    `draw`: "tick" draws a new force at each step; "session" keeps one rank in the distribution for the whole run, like
    one session of the experiment; "none" draws no force. A draw depends only on `seed` and the tick.
    """

    model: Annotated[str, "1"] = ""
    subject: Annotated[str, "1"] = ""
    mean: Annotated[str, "1"] = PUBLISHED.mean
    mean_parameters: Annotated[Vector, "SI"] = PUBLISHED.mean_parameters
    deviation: Annotated[str, "1"] = PUBLISHED.deviation
    deviation_parameters: Annotated[Vector, "SI"] = PUBLISHED.deviation_parameters
    depth_limit: Annotated[float, "m", msgspec.Meta(gt=0, le=1)] = PUBLISHED.limit
    freedom: Annotated[float, "1", msgspec.Meta(ge=0, le=1e6)] = PUBLISHED.freedom
    """Degrees of freedom of Student's t distribution of a new force about the mean; 0: normal distribution."""
    levels: Annotated[Vector, "1"] = (0.025, 0.5, 0.975)
    draw: Annotated[Literal["none", "tick", "session"], "1"] = "none"
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1)] = 0

    def __init__(self, **given: Any) -> None:
        if given.get("model"):
            given = {**given, **read_law(Path(str(given["model"])), str(given.get("subject", ""))), "model": ""}
        super().__init__(**given)
        for law in ("mean", "deviation"):
            name, parameters = getattr(self, law), getattr(self, f"{law}_parameters")
            if name not in MODELS:
                raise SettingError(f"setting {law!r} [1]: found {name!r}, expected one of {', '.join(MODELS)}")
            names = MODELS[name].parameters
            if len(parameters) != len(names) or not np.isfinite(parameters).all():
                wanted = ", ".join(f"{n} [{unit}]" for n, unit in names.items())
                raise SettingError(
                    f"setting '{law}_parameters' [SI]: found {list(parameters)}, expected {len(names)} finite numbers"
                    f" for {name!r}: {wanted}"
                )
        if not all(0.0 < p < 1.0 for p in self.levels) or len(self.levels) > 16:
            raise SettingError(f"setting 'levels' [1]: found {list(self.levels)}, expected up to 16 numbers in (0, 1)")

    def start(self) -> None:
        self.band = Band(*(getattr(self, name) for name in LAW_SETTINGS))
        self.rank = np.array(self.levels)
        self.session = uniform(self.seed, -1)

    def force_at(self, depth: float, tick: int) -> ForceBand:
        """The force at an indentation [m]; all zero when apart."""
        if not depth > 0.0:
            nothing = (0.0,) * len(self.levels)
            return ForceBand(
                mean=0.0, deviation=0.0, levels=self.levels, quantiles=nothing, sample=0.0, valid=depth == 0.0
            )
        mean, deviation, inside = (v.item() for v in band_at(depth, self.band))
        return ForceBand(
            mean=mean,
            deviation=deviation,
            levels=self.levels,
            quantiles=tuple(truncated_quantile(self.rank, mean, deviation, self.freedom).tolist()),
            sample=self._sample(mean, deviation, tick),
            valid=inside,
        )

    @part("sample", "sample", otherwise=0.0)
    def _sample(self, mean: float, deviation: float, tick: int) -> float:
        """A force [N] drawn from the band, for each message or for the session."""
        if self.draw == "none":
            return 0.0
        rank = self.session if self.draw == "session" else uniform(self.seed, tick)
        return float(truncated_quantile(rank, mean, deviation, self.freedom))


class Probabilistic(MeasuredSubject):
    """Mean force and spread from the indentation (docs/equations/probabilistic-force.md).

    Model, subject and draw are those of a measured subject: the published one, or one of a file of `palpate fit force`.

    `depth` is the quantity of the contact that corresponds to the measured indentation: "compression" of the fingertip
    (a rigid probe on a finger, as published), or "indentation" of the tissue (sessions on tissue). Without contact all
    outputs are 0.
    """

    effect = "band"

    depth: Annotated[Literal["compression", "indentation"], "1"] = "compression"

    def step(self, contact: Annotated[Contact, Wants("compression", "indentation")], *, dt: float) -> ForceBand:
        return self.force_at(contact.compression if self.depth == "compression" else contact.indentation, contact.tick)


def read_law(path: Path, subject: str) -> dict[str, Any]:
    """The settings of a subject in a file of `palpate fit force`; subject "": the only one.

    SettingError: the file is missing or has another format, or the subject is unknown.
    """
    try:
        check_readable(path, MOST_TEXT)
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        text = getattr(error, "strerror", None) or "not a YAML file"
        raise SettingError(f"setting 'model' [1]: cannot read {str(path)!r}: {text}") from None
    subjects = data.get("subjects") if isinstance(data, dict) else None
    if not isinstance(subjects, dict) or not subjects:
        raise SettingError(
            f"setting 'model' [1]: {str(path)!r} has no 'subjects'; write it with `palpate fit force SESSIONS.csv`"
        )
    known = {str(name): law for name, law in subjects.items()}
    if not subject and len(known) == 1:
        subject = next(iter(known))
    if subject not in known:
        raise SettingError(
            f"setting 'subject' [1]: found {subject!r}, expected one of those of {str(path)!r}: {', '.join(known)}"
        )
    law = known[subject]
    if not isinstance(law, dict) or set(law) | {"freedom"} != set(LAW_SETTINGS):
        raise SettingError(
            f"setting 'model' [1]: subject {subject!r} of {str(path)!r}: expected {', '.join(LAW_SETTINGS)}"
        )
    return law
