"""The answer of the study `table2`; units are those that people read (deg, mm)."""

from __future__ import annotations

from dataclasses import dataclass

from ...analysis.status import Status, known, require_no_more_than
from .answer import StudyAnswer


@dataclass(frozen=True)
class SimulatedStd:
    """Quantiles of the std of three simulated runs, deg."""

    q2_5: float
    median: float
    q97_5: float


@dataclass(frozen=True)
class ScatterParameter:
    """An offset: the paper's std of three runs with its 95 % interval, the std predicted at the joint noise
    that explains the scatter best, the joint noise that this offset alone requires, the std of three runs in
    the simulated cell, and of many simulated triples.

    Raises UnsoundResult where an unidentifiable offset has one of the latter four.
    """

    name: str
    unit: str
    status: Status
    paper_std: float
    low: float
    high: float
    predicted_std: float | None = None
    alone_deg: float | None = None
    simulated_std: float | None = None
    simulated: SimulatedStd | None = None

    def __post_init__(self) -> None:
        require_no_more_than(
            self.name,
            self.status,
            predicted_std=self.predicted_std,
            alone_deg=self.alone_deg,
            simulated_std=self.simulated_std,
            simulated=self.simulated,
        )

    @property
    def is_known(self) -> bool:
        return known(self.status)


@dataclass(frozen=True)
class PrincipalAxis:
    """A principal axis of the predicted covariance, with the joint noise that it alone requires."""

    combination: dict[str, float]
    predicted_std: float
    paper_std: float
    alone_deg: float


@dataclass(frozen=True)
class Table2Plan:
    """One plan: the joint noise that explains the paper's scatter best with its 95 % interval, the p-value of
    one noise for all offsets; `chi2`, `dof` and `chance` (its p-value) compare runs in the cell with the
    prediction. None where there is no result."""

    name: str
    words: str
    shots: int
    spot_mm: float
    joint_deg: float | None
    low: float | None
    high: float | None
    p_value: float | None
    agrees: bool
    chi2: float | None
    dof: int
    chance: float | None
    sentence: str
    axes: tuple[PrincipalAxis, ...]
    parameters: tuple[ScatterParameter, ...]


@dataclass(frozen=True)
class Paper:
    """Table 2 of the paper, deg: the runs, mean and std as printed, and as they follow from the runs."""

    offsets: tuple[str, ...]
    experiments: tuple[tuple[float, ...], ...]
    mean: tuple[float, ...]
    std: tuple[float, ...]
    printed_mean: tuple[float, ...]
    printed_std: tuple[float, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Table2Settings:
    """How the study was carried out; `simulated` triples, `chance` of a false alarm over both plans."""

    seed: int
    runs: int
    simulated: int
    chance: float


@dataclass(frozen=True, kw_only=True)
class Table2Study(StudyAnswer):
    """The whole answer."""

    settings: Table2Settings
    paper: Paper
    plans: tuple[Table2Plan, ...]
