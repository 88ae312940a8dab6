"""The answer of the study `cell`; units are those that people read (deg, mm, s)."""

from __future__ import annotations

from dataclasses import dataclass

from .answer import NoiseLevel, ObservedParameter, Share, StudyAnswer, require_sound


@dataclass(frozen=True)
class CellParameter(ObservedParameter):
    """An offset of a plan, with the share of its intervals; None where no run determines it."""

    coverage: Share | None = None

    @property
    def shares(self) -> tuple[Share, ...]:
        return () if self.coverage is None else (self.coverage,)


@dataclass(frozen=True)
class PhaseSeconds:
    """Time of a run in one phase, on the cell's clock: mean and longest; None where no run has ended."""

    mean: float | None = None
    max: float | None = None


@dataclass(frozen=True)
class ShotsUsed:
    """Measurements of a run; None where no run has ended."""

    mean: float | None = None
    min: int | None = None
    max: int | None = None


@dataclass(frozen=True)
class CellPlan:
    """One plan: `failed` runs without a result and why, `refused` measurements over all runs, `contradicted`
    runs that contradict the model; `seconds` by phase and in `total`; `saved` is the mean number of postures
    that an adaptive run did without, `computing_s` the real time of a run.

    Raises UnsoundResult where an unidentifiable parameter has a number, unless it is a control.
    """

    name: str
    words: str
    control: bool
    agrees: bool
    sentence: str
    robot: str
    shots: int
    noise: NoiseLevel
    runs: int
    failed: int
    failures: tuple[str, ...]
    refused: int
    contradicted: int
    parameters: tuple[CellParameter, ...]
    seconds: dict[str, PhaseSeconds]
    within_limit: bool | None
    shots_used: ShotsUsed
    saved: float | None
    computing_s: float | None

    def __post_init__(self) -> None:
        require_sound(self.name, self.control, self.parameters)


@dataclass(frozen=True)
class CellCase:
    """A finished plan as it is kept; with the control that is made of its runs, if any."""

    plan: CellPlan
    control: CellPlan | None = None


@dataclass(frozen=True)
class CellSettings:
    """How the study was carried out; `chance` is that of a false alarm over the offsets of a plan."""

    runs: int
    seed: int
    level: float
    camera: bool
    chance: float
    limit_s: float
    tolerance_deg: float


@dataclass(frozen=True, kw_only=True)
class CellStudy(StudyAnswer):
    """The whole answer."""

    settings: CellSettings
    plans: tuple[CellPlan, ...]
