"""The answer of an analysis, as a value: what is known, how well, and what cannot be known.

Units are those that people read (degrees, millimetres), as in `result.json`. Whatever has no
answer is None, and every None has one stated meaning.
"""

from __future__ import annotations

import json
import re
from dataclasses import field
from typing import Annotated, Final, Literal

from ...model.errors import UnsoundResult
from ...model.instruments.kind import Instrument
from ...model.instruments.registry import kinds_of
from ...model.parsing.reading import shown
from ...model.records import internal, it, read, record, worded
from ..covariance import OffsetsWithoutPrior
from ..diagnostics.accuracy import TcpAccuracy
from ..diagnostics.budget import Budget
from ..diagnostics.diagnosis import Explanation
from ..diagnostics.hold_out import HoldOut, PlacementResult
from ..diagnostics.null_motion import NullSpaceMotion
from ..diagnostics.outliers import Robust, ShotResult
from ..diagnostics.scene_data import RunScene
from ..diagnostics.values_to_enter import Conformity, Entered
from ..estimation.midpoint import MidpointFit
from ..misfit import Misfit
from ..observability.geometry_result import Basis, GeometryResult
from ..observability.identifiability import Identifiability
from ..observability.outlook import Outlook
from ..observability.power import DetectionPower
from ..posterior.posterior import Intervals, PosteriorSummary
from ..prediction import PredictedRun
from ..solution import ParameterResult, ParameterTable
from ..status import UNVALIDATED, Status, Verdict, as_grave, has_numbers, verdict_of
from ..tcp_region import TcpRegion
from .answer_message import Message
from .findings import Finding

RESULT_SCHEMA: Final = "zerobeam/result/1"
_SURROGATE = re.compile(r"\\u[dD][89abAB]")
_ALONE = re.compile("[\ud800-\udfff]")


@record(needed=("converged", "reason", "noise_scale", "chi2", "dof", "p_value"))
class LikelihoodSummary:
    """The likelihood fit in numbers; `reason` is why the optimiser stopped.

    `chi2` of the residuals, `dof` the numbers left over, `p_value` None where the noise is estimated
    (`noise_scale` is then its multiple of the stated, unless there are factors that are parameters) or no
    number is left over. `p_small` is that of residuals as small, of an arm without any deviation.
    """

    converged: Annotated[bool, it("whether it has an answer")]
    reason: Annotated[str, it("termination, in words")]
    iterations: Annotated[int, it("how many")]
    cost: Annotated[float, it("at the end")]
    rms_mm: Annotated[float, it("of the residuals in lengths, millimetres")]
    rms_before_mm: Annotated[float, it("the same without any offset, millimetres")]
    rms_deg: Annotated[float | None, it("of the angles that a pose has, degrees")]
    rms_before_deg: Annotated[float | None, it("the same without any offset, degrees")]
    chi2: Annotated[float, it("of the normalised residuals")]
    dof: Annotated[int, it("degrees of freedom")]
    p_value: Annotated[
        float | None, it("of χ²; null where the noise is estimated or no degree of freedom is left")
    ]
    noise_scale: Annotated[
        float | None, it("the noise as a multiple of the stated one, where it is estimated")
    ]
    noise_known: Annotated[bool, internal]
    other_basins: Annotated[int, it("number of other local optima")]
    p_small: Annotated[
        float | None,
        it(
            "p-value of residuals as small, the noise as stated, of an arm without any deviation; "
            "null where the noise is estimated, and without an answer"
        ),
    ] = None
    available: Annotated[bool, it("false where the cost is not defined for these data")] = True
    message: Annotated[str | None, worded("what else is to be known, in words")] = field(
        default=None, kw_only=True
    )


@record(needed=("likelihood",))
class FitSummaries:
    """The likelihood fit and the paper's."""

    likelihood: Annotated[LikelihoodSummary, it("of the likelihood: the answer")]
    midpoint: Annotated[MidpointFit, it("of the paper (eq. 8)")]


@record
class DistanceResult:
    """A stated distance between two targets next to what the fit makes of it."""

    between: tuple[str, str]
    mm: float
    sigma_mm: float
    estimate: float | None
    std: float | None


@record
class AngleResult:
    """A stated angle between two planes, degrees, next to what the fit makes of it."""

    between: tuple[str, str]
    deg: float
    sigma_deg: float
    estimate: float | None
    std: float | None


@record
class RunInputs:
    """What was made of a run: its file with the SHA-256, its robot and number of measurements."""

    run: str
    sha256: str
    robot: str
    shots: int
    seed: int
    versions: dict[str, str]


@record
class Inputs(RunInputs):
    """What the result was made from: enough to make it again."""

    targets: tuple[str, ...]
    header: dict[str, object]
    vendor: str | None = None
    stated: dict[str, object] | None = None

    def __post_init__(self) -> None:
        for key in ("provenance", "noise", "tool"):
            if not isinstance(self.header.get(key, {}), dict):
                raise UnsoundResult(f"inputs.header.{key} is no mapping")

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


@record(
    kw_only=True,
    needed=("verdict", "headline", "parameters", "fits", "posterior", "shots", "notes", "inputs"),
)
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
    outlook : Outlook or None
        What would make the answer better: remedies by their predicted gain; None of a misfit.
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
    (10, 'irb1600')
    """

    schema: Annotated[Literal["zerobeam/result/1"], it("kind and version of the document")] = RESULT_SCHEMA
    verdict: Annotated[
        Verdict,
        it(
            "over all offsets; where the model does not describe the measurements, every parameter "
            "that the data determine has the status `unvalidated`"
        ),
    ]
    message: Annotated[
        Message | None,
        worded(
            "what report, terminal, Python and app show first, in sentences: `verdict` (of a pass "
            "with what it is subject to; with U and its coverage factor k; `Simulated:` of a "
            "simulated run), `worst` (the least well determined offset: `name`, `value`, its expanded"
            " uncertainty U, null where it is not determined, `unit`, `text`; null for a misfit), "
            "`cause` (of a misfit its best explanation, of a degenerate run the mechanism, of a weak "
            "one the limit, of a pass the evidence against it; else null), `action` (`text`, and "
            "`command`, the command to type, or null), `cautions` (the gravest first), `basis` (what "
            "was stated, and what was assumed with what it does to U), `grade` (`pass`, `weak`, "
            "`degenerate`, `misfit`, `held`: how it is coloured; a pass that something speaks against"
            " is `weak`, one of a simulated run `held`), `may` (`enter`, `certify`, `export`: what "
            "may be done with it). Of a misfit it has nothing that follows from the wrong model"
        ),
    ] = None
    coverage_factor: Annotated[
        float,
        it(
            "k of every expanded uncertainty U = k u: 2, or Student's factor where the noise scale is"
            " estimated and that is larger"
        ),
    ]
    headline: Annotated[str | None, it("the verdict in a sentence")] = None
    parameters: Annotated[ParameterTable, it("a row each")]
    without_prior: Annotated[
        OffsetsWithoutPrior | None,
        it("the identifiable offsets by the measurements alone, null where there is none"),
    ] = None
    identifiability: Annotated[Identifiability, it("rank, condition, null space")]
    fits: Annotated[FitSummaries, it("null where a fit does not define a number")]
    geometry: Annotated[
        GeometryResult, it("tolerances, the model ladder, and the offsets with nominal geometry")
    ]
    posterior: Annotated[PosteriorSummary, it("of the sampling")]
    shots: Annotated[
        tuple[ShotResult, ...],
        it(
            "the measurements, a list of `shot`, `target`, `miss_mm` (residual: the lengths that were"
            " read), `miss_deg` (the angles, empty without any), `length_mm` (length of `miss_mm`; of"
            " several readings their root mean square), `whitened` (length of the normalised "
            "residual), `leave_one_out` (length in mm of the leave-one-out residual, by a fit without"
            " the measurement, of more than 300 measurements by one Newton step; null at leverage 1, "
            "or if that fit failed), `cooks` (Cook's distance, by the same fit; null likewise)"
        ),
    ]
    distances: Annotated[
        tuple[DistanceResult, ...], it("a list of `between`, `mm`, `sigma_mm`, `estimate`, `std`")
    ] = ()
    angles: Annotated[
        tuple[AngleResult, ...], it("a list of `between`, `deg`, `sigma_deg`, `estimate`, `std` (degrees)")
    ] = ()
    intervals: Annotated[
        tuple[Intervals, ...],
        it(
            "the 95 % intervals by three methods, of offsets, tool and noise that are weakly observable or"
            " where two methods differ"
        ),
    ] = ()
    accuracy: Annotated[
        TcpAccuracy, it("of the TCP over the region, with nothing and with the values of `enter` entered")
    ]
    budget: Annotated[
        tuple[Budget, ...],
        it(
            "the uncertainty budget by the GUM of each identifiable offset and tool parameter; empty "
            "where the fit did not converge"
        ),
    ] = ()
    robust: Annotated[Robust | None, it("of `--robust`, else null")]
    hold_out: Annotated[
        HoldOut | PredictedRun | None,
        it(
            "of `--hold-out`, else null; its numbers are null where there is no test: the fit did not"
            " converge, or a target has no more numbers than coordinates"
        ),
    ]
    placements: Annotated[
        PlacementResult,
        it("each placement as the others predict it, the jackknife, correlation and steps of the recordings"),
    ]
    scene: Annotated[
        RunScene | None,
        it(
            "content of the 3D picture, null where the fit did not converge: `shots` (at most 60, "
            "evenly over the run), `targets`, `radius2` (squared radius in standard deviations of the"
            " 95 % ellipsoid of a position: 7.815, or 3 F(3, dof) where the noise scale is "
            "estimated). A measurement: `shot`, `target`, `links` (points from the base over joints "
            "and flange to laser or tip, mm, base frame), `beam_to` (the point of the beam nearest to"
            " the target, null for a probe), `ahead` (false: the laser points away), `sights` (lines "
            "to what other instruments measure, two points each), `residual_mm` (the residual as a vector:"
            " from what is measured, by the fit, to where this measurement has it; null where that has no"
            " place). `outlines`: of planes and balls "
            "`target` and `lines`. A target: `name`, `at_mm` (null: unidentifiable), `covariance_mm2`"
            " (3 × 3, null if unidentifiable or held). Unidentifiable offsets and tool parameters are"
            " shown at their prior means"
        ),
    ]
    null_motion: Annotated[
        NullSpaceMotion | None,
        it(
            "of a degenerate run a motion of arm and targets that leaves the readings as they are, for its"
            " picture; null where there is none. No place in it is an estimate. `offset` differs by `amount`"
            " (`unit`) at either end, and what is `moved` with it; `drawn`: how many times larger the frames"
            " show it; `off_mm` and `noise_share`: how far readings are from what was read at the ends, mm,"
            " and root of the sum of squared normalised residuals; `direction`: which of the null space;"
            " `targets`: names; `marked`: which point has a mark; `shots`: numbers of what is"
            " drawn, each `like` a `measurement` or `posture`;"
            " `frames`: `share` (−1 and 1 at the ends), places of `targets`, `postures` and `new` ones:"
            " `links` and `beam_to` as in `scene`, `mark` (a point beside that), `sights`, `off_mm`;"
            " `new`: postures that end it: `like` which number, `joints` in `units`, `off_mm` at the ends"
        ),
    ] = None
    misfit: Annotated[Misfit | None, it("null, or why the model does not describe the measurements")]
    diagnosis: Annotated[
        tuple[Explanation, ...],
        it("what explains a misfit, the best explanation first, empty where nothing does or there is none"),
    ] = ()
    enter: Annotated[
        Entered | None,
        it(
            "the values that serve a controller with nominal geometry best, null where nothing may be"
            " entered (`next_steps.enter` is empty)"
        ),
    ] = None
    enter_geometry: Annotated[
        Entered | None,
        it(
            "the same for what takes the links too (`export robot`, `urdf`): the estimates of the "
            "offsets and links that are determined. Null of an exact arm"
        ),
    ] = None
    conformity: Annotated[
        Conformity | None,
        it(
            "null without `required` in the header, or without `enter`: `required_mm`, `tcp_95_mm` "
            "(what 95 % of the region stays below with the values of `enter`, the middle of its "
            "posterior), `probability` (that it is within the requirement), `decision` (`conforms`, "
            "`does not conform`, `undecided`), `rule`"
        ),
    ] = None
    region: Annotated[
        TcpRegion | None,
        it(
            "the region of every error of the TCP in this document (`workspace` of the header): "
            "`joints` (`central`, `full`; null of a file's postures), `box_mm`, `positions`, `postures` "
            "(of the file), `name` (in words)"
        ),
    ] = None
    power: Annotated[
        tuple[DetectionPower, ...],
        it(
            "the probability with which such a run detects each wrong model, at the estimates. A pass"
            " is subject to the absence of each that is `dangerous`, and `message.verdict` says so; "
            "empty where nothing is tested, and of a misfit"
        ),
    ] = ()
    taken_as_known: Annotated[
        tuple[Basis, ...],
        it(
            "what the answer takes as known of tool, instruments and links besides the measurements, "
            "whether the header states it or it is assumed"
        ),
    ] = ()
    outlook: Annotated[
        Outlook | None,
        it("what would make it better: remedies by their predicted gain; null of a misfit"),
    ] = None
    notes: Annotated[tuple[str, ...] | None, it("findings in sentences, the gravest first")] = None
    next_steps: Annotated[
        NextSteps | None,
        it(
            'the first page\'s "What to do": `enter`, the values to enter in the controller (`name`, '
            "`value`, `expanded_u`, and `estimate`, the offset of the arm; rounded texts), empty "
            "unless the verdict is `pass` and nothing speaks against it; `steps`, a list of `text` "
            "and `commands`, the first of them the `action` of `message`"
        ),
    ] = None
    inputs: Annotated[
        Inputs,
        it(
            "`run`, `sha256`, `robot`, `shots`, `targets`, `seed`, `versions`, `header` (with the default of"
            " each key that it does not state), `vendor` (of the robot, null where its file states none),"
            " `stated` (the keys of `header` that it states; null in results of earlier versions)"
        ),
    ]
    findings: Annotated[tuple[Finding, ...], internal]
    entered: Annotated[Entered | None, internal] = None
    entered_geometry: Annotated[Entered | None, internal] = None

    @property
    def likelihood(self) -> LikelihoodSummary:
        """The likelihood fit."""
        return self.fits.likelihood

    @property
    def midpoint(self) -> MidpointFit:
        """The paper's fit."""
        return self.fits.midpoint

    @property
    def offsets(self) -> tuple[ParameterResult, ...]:
        """The rows of the joint offsets."""
        return tuple(row for row in self.parameters if row.group == "offset")

    def __post_init__(self) -> None:
        needed = verdict_of(row.status for row in self.parameters if row.group == "offset")
        if not as_grave(self.verdict, needed):
            raise UnsoundResult(
                f"verdict {self.verdict!r}, but the statuses of its offsets make it {needed!r}"
            )
        if self.verdict != "pass" and self.next_steps is not None and self.next_steps.enter:
            raise UnsoundResult(f"the verdict is {self.verdict}, yet there are values to enter")
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
        if self.outlook is not None:
            with_u = {name for name, u in self.outlook.now.U.items() if u is not None}
            self._refuse(unknown & with_u, "an uncertainty in its outlook")
        if self.robust is not None:
            self._refuse(
                unknown & {row.name for row in self.robust.parameters if row.estimate is not None},
                "a robust estimate",
            )
        if self.placements is not None and self.placements.jackknife is not None:
            self._refuse(unknown & {row.name for row in self.placements.jackknife.offsets}, "a jackknife")
        if self.null_motion is not None and self.null_motion.offset not in unknown:
            raise UnsoundResult(f"{self.null_motion.offset} is determined, yet a motion shows it as open")
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


@record
class EnteredValue:
    """What is to be entered of a joint: its `value` and expanded uncertainty U, and the `estimate` of
    the arm's offset, rounded, with units, and the `status` of the value; `estimate` and `status` are None in
    results of earlier versions."""

    name: str
    value: str
    expanded_u: str
    estimate: str | None = None
    status: Status | None = None


@record
class NextStep:
    """A sentence, and the commands that do what it says."""

    text: str
    commands: tuple[str, ...] = ()


@record
class NextSteps:
    """`enter` is empty where nothing may be entered; the first of the `steps` then says why."""

    enter: tuple[EnteredValue, ...]
    steps: tuple[NextStep, ...]


@record
class _Kind:
    """What kind of document it is."""

    schema: str | None = None


def parse_result(text: str) -> Result:
    """What a result.json says. ValueError says what is wrong where it is none, not whole, or contradicts
    itself."""
    if _SURROGATE.search(text):  # which pydantic refuses, although JSON may have one alone
        text = _ALONE.sub("\ufffd", json.dumps(json.loads(text), ensure_ascii=False))
    kind = read(_Kind, text).schema
    if kind != RESULT_SCHEMA:
        raise ValueError(f"schema {shown(kind)}")
    return read(Result, text)
