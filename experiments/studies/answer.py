"""What the answers of all studies have in common, and the one writer of `study.json` (docs/files.md).

Units are those that people read (deg, mm, s). What a plan does not identify has no number, save in a
control, which is wrong on purpose: the dataclasses refuse to be made otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from ...analysis.status import Status, require_no_more_than

SCHEMA = "zerobeam/study/1"


@dataclass(frozen=True, kw_only=True)
class StudyAnswer:
    """What is asked, the answer in a sentence, and whether all that must agree agrees."""

    study: str
    title: str
    headline: str
    agrees: bool
    seconds: float
    versions: dict[str, str]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class NoiseLevel:
    """The stated noise of a plan."""

    joint_deg: float
    spot_mm: float


@dataclass(frozen=True)
class Share:
    """How many of the intervals of `level` hold the truth: the share, with its 95 % binomial interval
    (Clopper and Pearson), and whether it agrees with the level."""

    level: float
    held: int
    of: int
    share: float
    low: float
    high: float
    agrees: bool


@dataclass(frozen=True)
class ObservedParameter:
    """Errors (estimate minus truth) of one parameter over many runs: bias with its Monte Carlo standard error
    `bias_mcse`, rmse, and the root mean square of the standard uncertainties that the runs state."""

    name: str
    unit: str
    status: Status
    bias: float | None
    bias_mcse: float | None
    rmse: float | None
    predicted_std: float | None

    @property
    def shares(self) -> tuple[Share, ...]:
        """The shares that there are, one a level."""
        raise NotImplementedError


def require_sound(what: str, control: bool, parameters: Iterable[ObservedParameter]) -> None:
    """Raise UnsoundResult if a parameter that is not determined has a number, and `what` is no control."""
    for own in () if control else parameters:
        require_no_more_than(
            f"{own.name} of {what}",
            own.status,
            bias=own.bias,
            bias_mcse=own.bias_mcse,
            rmse=own.rmse,
            predicted_std=own.predicted_std,
            coverage=own.shares or None,
        )


def to_json(answer: StudyAnswer) -> dict[str, Any]:
    """The content of `study.json`."""
    content = TypeAdapter(type(answer)).dump_python(answer, mode="json", by_alias=True)
    return {"schema": SCHEMA, **content}
