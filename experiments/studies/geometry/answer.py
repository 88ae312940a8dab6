"""The answer of the study `geometry`; units are those that people read (deg, mm, s)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ....analysis.status import require_no_more_than
from ..answer import NoiseLevel, ObservedParameter, Share, StudyAnswer, require_sound

EstimatorName = Literal["freed", "considered", "nominal", "tolerances understated by 3"]


@dataclass(frozen=True)
class GeometryParameter(ObservedParameter):
    """An offset by one estimator over many arms.

    `coverage` is the share of its intervals; `z` the root mean square of its errors in standard
    uncertainties, with the 95 % interval `z_low` to `z_high` (chi-squared); `checked_std` what `check`
    predicts for the plan.
    """

    coverage: Share | None = None
    z: float | None = None
    z_low: float | None = None
    z_high: float | None = None
    checked_std: float | None = None

    @property
    def shares(self) -> tuple[Share, ...]:
        return () if self.coverage is None else (self.coverage,)


@dataclass(frozen=True)
class GeometryEstimator:
    """What one way to treat the geometry came to on a plan; `converged` counts the arms with a fit, `misfit`
    those whose answer says that the model does not describe the measurements.

    Raises UnsoundResult where an unidentifiable parameter has a number, unless it is a control.
    """

    name: EstimatorName
    words: str
    control: bool
    agrees: bool
    converged: int
    misfit: int
    sentence: str
    parameters: tuple[GeometryParameter, ...]

    def __post_init__(self) -> None:
        require_sound(self.name, self.control, self.parameters)
        for row in () if self.control else self.parameters:
            bounds = {"z_low": row.z_low, "z_high": row.z_high}
            require_no_more_than(
                f"{row.name} of {self.name}", row.status, z=row.z, checked_std=row.checked_std, **bounds
            )


@dataclass(frozen=True)
class ToleranceLevel:
    """The tolerances of all links: one standard deviation of the simulated arms."""

    length_mm: float
    angle_deg: float


@dataclass(frozen=True)
class CheckedOffset:
    """What `check` predicts of one offset before any measurement, None where the plan does not determine it:
    with nominal geometry and an arm of nominal geometry (`noise_only`), with nominal geometry and an arm that
    has the tolerances (`considered`), with the geometry estimated (`freed`)."""

    name: str
    unit: str
    noise_only: float | None
    considered: float | None
    freed: float | None


@dataclass(frozen=True)
class GeometryPlan:
    """One plan: `chosen_for` the geometry that it was made for, None where it was not chosen; `failed` counts
    arms drawn again because they cannot hit the target."""

    name: str
    words: str
    chosen_for: Literal["nominal", "freed"] | None
    robot: str
    shots: int
    noise: NoiseLevel
    tolerance: ToleranceLevel
    arms: int
    failed: int
    efficiency: float | None
    checked: tuple[CheckedOffset, ...]
    estimators: tuple[GeometryEstimator, ...]


@dataclass(frozen=True)
class GeometrySettings:
    """How the study was carried out; `chance` is that of a false alarm over the offsets of an estimator."""

    arms: int
    seed: int
    level: float
    chance: float
    candidates: int
    offset_deg: float


@dataclass(frozen=True, kw_only=True)
class GeometryStudy(StudyAnswer):
    """The whole answer."""

    settings: GeometrySettings
    plans: tuple[GeometryPlan, ...]
