"""The answer of an analysis, as a value: what is known, how well, and what cannot be known.

Units are those that people read (degrees, millimetres), as in `result.json`. Whatever has no
answer is None, and every None has one stated meaning.
"""

from __future__ import annotations

from dataclasses import dataclass

from ...model.errors import UnsoundResult
from ...model.instruments.kind import Instrument
from ...model.instruments.registry import kinds_of
from ..covariance import OffsetsWithoutPrior
from ..diagnostics.accuracy import TcpAccuracy
from ..diagnostics.budget import Budget
from ..diagnostics.diagnosis import Explanation
from ..diagnostics.enter import Conformity, Entered
from ..diagnostics.hold_out import HoldOut, PlacementResult
from ..diagnostics.influence import ShotResult
from ..diagnostics.outliers import Robust
from ..diagnostics.predicted_run import PredictedRun
from ..diagnostics.scene import RunScene
from ..misfit import Misfit
from ..observability.basis import Basis
from ..observability.geometry import GeometryResult
from ..observability.identifiability import Identifiability
from ..observability.power import DetectionPower
from ..posterior.intervals import Intervals
from ..posterior.posterior import PosteriorSummary
from ..solution import ParameterTable
from ..status import UNVALIDATED, Verdict, as_grave, has_numbers, verdict_of
from .findings import Finding

RESULT_SCHEMA = "zerobeam/result/1"


@dataclass(frozen=True)
class LikelihoodSummary:
    """The likelihood fit in numbers; `reason` is why the optimiser stopped.

    `chi2` of the residuals, `dof` the numbers left over, `p_value` None where the noise is estimated
    (`noise_scale` is then its multiple of the stated, unless there are factors that are parameters) or no
    number is left over. `p_small` is that of residuals as small, of an arm without any deviation.
    """

    converged: bool
    reason: str
    iterations: int
    cost: float
    rms_mm: float
    rms_before_mm: float
    rms_deg: float | None
    rms_before_deg: float | None
    chi2: float
    dof: int
    p_value: float | None
    noise_scale: float | None
    noise_known: bool
    other_basins: int
    p_small: float | None = None


@dataclass(frozen=True)
class MidpointSummary:
    """The paper's own fit (eq. 8). `available` is False where its cost is not defined for these data
    (parallel beams, say); `unused` are targets that it could not use."""

    available: bool
    converged: bool
    reason: str
    iterations: int
    cost: float | None
    rms_mm: float | None
    message: str | None

    def __post_init__(self) -> None:
        if not self.available and (self.cost is not None or self.rms_mm is not None):
            raise UnsoundResult("the midpoint fit is not available, yet it has numbers")


@dataclass(frozen=True)
class DistanceResult:
    """A stated distance between two targets next to what the fit makes of it."""

    between: tuple[str, str]
    mm: float
    sigma_mm: float
    estimate: float | None
    std: float | None


@dataclass(frozen=True)
class AngleResult:
    """A stated angle between two planes, degrees, next to what the fit makes of it."""

    between: tuple[str, str]
    deg: float
    sigma_deg: float
    estimate: float | None
    std: float | None


@dataclass(frozen=True)
class Inputs:
    """What the result was made from: enough to make it again."""

    run: str
    sha256: str
    robot: str
    shots: int
    targets: tuple[str, ...]
    seed: int
    versions: dict[str, str]
    header: dict[str, object]
    vendor: str | None = None

    @property
    def instruments(self) -> dict[str, type[Instrument]]:
        """The kind of each instrument, by its label."""
        return kinds_of(self.header)

    @property
    def calibrated(self) -> bool:
        """Whether the tool was taken as known."""
        return bool(self._of("tool").get("calibrated", True))

    @property
    def noise_known(self) -> bool:
        """Whether the noise was taken as known, and not estimated."""
        return self._of("noise").get("scale", "known") == "known"

    @property
    def provenance(self) -> dict[str, object]:
        """What the run says of its origin."""
        return self._of("provenance")

    def _of(self, key: str) -> dict[str, object]:
        value = self.header.get(key)
        return value if isinstance(value, dict) else {}


@dataclass(frozen=True)
class Result:
    """The whole answer to a recorded run as data, in degrees and mm: what `result.json` and a report say.

    Attributes
    ----------
    verdict : str
        "pass", "weak" or "degenerate", over all offsets; "misfit" where the model does not describe the
        measurements.
    parameters : ParameterTable
        A row for each parameter.
    identifiability : Identifiability
        Rank, singular values, and the null-space directions with causes.
    likelihood, midpoint, robust, hold_out
        The fits; the last two are None where they were not asked for.
    placements : PlacementResult
        Each placement left out in turn, jackknife, correlation and steps of the recordings.
    geometry : GeometryResult
        Tolerances, the model ladder, and what the offsets are worth with nominal geometry.
    posterior : PosteriorSummary
        Diagnostics and summaries of the draws.
    shots, distances, angles, intervals, accuracy, budget, scene
        Residuals and influence of each measurement, stated distances and angles, 95 % intervals by several
        methods, accuracy at the TCP, uncertainty budget, what a picture needs.
    misfit : Misfit or None
        Why the model does not describe the measurements; None where nothing speaks against it.
    findings : tuple
        What a reader must not miss, the gravest first.
    inputs : Inputs
        What the answer was made from.
    diagnosis : tuple
        What explains a misfit, the best explanation first; empty where nothing does or there is none.
    entered, entered_geometry, conformity
        Values that serve a controller with nominal geometry best, and one that takes the estimated geometry,
        each with the error of the TCP to expect; whether the robot with the first meets what the header
        requires. None where nothing can be promised; the second also of an exact arm.
    coverage_factor : float
        k of every expanded uncertainty U of this answer.
    power : tuple of DetectionPower
        With which probability such a run notices a wrong model; empty where nothing is tested, and of a
        misfit.
    without_prior : OffsetsWithoutPrior or None
        The identifiable offsets without any prior, with their covariance; None where there is none.
    taken_as_known : tuple of Basis
        What the header states of tool, instruments and links, and what is assumed of them.

    Raises
    ------
    UnsoundResult
        One part claims more than the statuses in `parameters` allow.

    Examples
    --------
    >>> import zerobeam as zb
    >>> from zerobeam.experiments.demos import demo_runs
    >>> result = zb.analyse(zb.read_run(demo_runs()[0].path), ess=100).result
    >>> result.likelihood.dof, result.inputs.robot
    (6, 'irb1600')
    """

    verdict: Verdict
    parameters: ParameterTable
    identifiability: Identifiability
    likelihood: LikelihoodSummary
    midpoint: MidpointSummary
    geometry: GeometryResult
    posterior: PosteriorSummary
    shots: tuple[ShotResult, ...]
    distances: tuple[DistanceResult, ...]
    angles: tuple[AngleResult, ...]
    intervals: tuple[Intervals, ...]
    accuracy: TcpAccuracy
    budget: tuple[Budget, ...]
    robust: Robust | None
    hold_out: HoldOut | PredictedRun | None
    placements: PlacementResult
    scene: RunScene | None
    misfit: Misfit | None
    findings: tuple[Finding, ...]
    inputs: Inputs
    diagnosis: tuple[Explanation, ...] = ()
    entered: Entered | None = None
    entered_geometry: Entered | None = None
    conformity: Conformity | None = None
    power: tuple[DetectionPower, ...] = ()
    coverage_factor: float = 2.0
    without_prior: OffsetsWithoutPrior | None = None
    taken_as_known: tuple[Basis, ...] = ()

    def __post_init__(self) -> None:
        needed = verdict_of(row.status for row in self.parameters if row.group == "offset")
        if not as_grave(self.verdict, needed):
            raise UnsoundResult(
                f"verdict {self.verdict!r}, but the statuses of its offsets make it {needed!r}"
            )
        if (self.verdict == "misfit") != (self.misfit is not None):
            raise UnsoundResult(f"verdict {self.verdict!r}, but misfit is {self.misfit}")
        if self.misfit is not None:
            trusted = {row.name for row in self.parameters if row.status in ("identified", "weak", "assumed")}
            self._refuse(trusted, "a status that a misfit does not allow")
        elif any(row.status == "unvalidated" for row in self.parameters):
            raise UnsoundResult("a parameter is unvalidated, but there is no misfit")
        held = {row.name for row in self.parameters if row.held}
        unknown = {row.name for row in self.parameters if not has_numbers(row.status)}
        if self.without_prior is not None:
            self._refuse(unknown & set(self.without_prior.names), "a value without prior")
        self._refuse(unknown & {row.name for row in self.intervals}, "an interval")
        self._refuse(unknown & {row.name for row in self.budget}, "a budget")
        self._refuse(
            unknown & {row.name for row in self.posterior.parameters or () if row.source == "data"},
            "a posterior from the data",
        )
        if self.robust is not None:
            self._refuse(
                unknown & {row.name for row in self.robust.parameters if row.estimate is not None},
                "a robust estimate",
            )
        if self.placements.jackknife is not None:
            self._refuse(unknown & {row.name for row in self.placements.jackknife.offsets}, "a jackknife")
        if self.scene is not None:
            self._refuse((unknown - held) & set(self.scene.coordinates), "a place in the scene")

    def __repr__(self) -> str:
        verdict = self.verdict if self.misfit is None else f"{self.verdict}, {UNVALIDATED}"
        return f"<Result of {self.inputs.run}: {verdict}>"

    @staticmethod
    def _refuse(names: set[str], what: str) -> None:
        if names:
            raise UnsoundResult(
                f"{', '.join(sorted(names))} cannot be determined, yet the result has {what} of it"
            )


@dataclass(frozen=True)
class EnteredValue:
    """What is to be entered of a joint: its `value` and expanded uncertainty U, and the `estimate` of
    the arm's offset, rounded, with units; `estimate` is None in results of earlier versions."""

    name: str
    value: str
    expanded_u: str
    estimate: str | None = None


@dataclass(frozen=True)
class NextStep:
    """A sentence, and the commands that do what it says."""

    text: str
    commands: tuple[str, ...] = ()


@dataclass(frozen=True)
class NextSteps:
    """`enter` is empty where nothing may be entered; the first of the `steps` then says why."""

    enter: tuple[EnteredValue, ...]
    steps: tuple[NextStep, ...]
