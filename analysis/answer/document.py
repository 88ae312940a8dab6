"""The documents of a result (`result.json`) and of a check: the one place that knows their keys.

`ResultDocument` is what is written, `from_json` what is read back of it. Sentences come from `words`. The
descriptions of the keys are those of `zerobeam schema` and of the tables in docs/files-results.md.
"""

from __future__ import annotations

import json
import re
from typing import Annotated, Literal, Self

from pydantic import Field, ValidationError, model_validator

from ...model.parsing.reading import shown
from ..diagnostics.accuracy import Map, Region
from ..diagnostics.budget import BudgetRow, LinearCheck
from ..diagnostics.cause import Cause
from ..diagnostics.enter import Conformity, TakenGeometry, TcpError
from ..diagnostics.influence import ShotResult
from ..diagnostics.misreadings import Misreading
from ..diagnostics.predicted_run import PredictedMeasurement
from ..diagnostics.scene import RunScene
from ..estimation.robust import Loss
from ..estimation.tolerance_factors import Factors
from ..observability.causes import Tried
from ..observability.check import CheckedPosture, PlanInputs
from ..observability.geometry import Confounded, Rung, Tolerance
from ..observability.outlook import Advice, CurvePoint, OverTarget
from ..observability.power import WrongModel
from ..posterior.posterior import Agreement, PosteriorParameter
from ..recordings.recordings import RecordingCorrelation
from ..recordings.steps import RecordingStep
from ..status import Status, UnsoundResult, Verdict, has_numbers
from .document_part import DocumentPart, Interval, Number
from .message import Message
from .misfit_document import MisfitDocument, SentenceDocument
from .result import RESULT_SCHEMA, AngleResult, DistanceResult, Inputs, NextSteps

Rows = tuple[tuple[float, ...], ...]
ReadPoint = tuple[float, float, float]
_SURROGATE = re.compile(r"\\u[dD][89abAB]")
_ALONE = re.compile("[\ud800-\udfff]")


class ParameterDocument(DocumentPart):
    """A row of `parameters`: an offset has `tolerance_share` too."""

    name: str = Field(description="of the parameter, as `delta2` (docs/conventions.md)")
    unit: str = Field(
        description="`deg`, `mm`, or `1` for a factor on the noise: 1.2 means 1.2 times the stated noise"
    )
    status: Status = Field(description="what the data determine")
    held: bool = Field(description="whether it is not estimated")
    estimate: Number = Field(
        description="the mode of the posterior; the value of a held parameter; null if unidentifiable"
    )
    std: Number = Field(description="standard uncertainty at the mode; null if unidentifiable or held")
    data_std: Number = Field(
        None,
        description=(
            "standard uncertainty without prior; null if held, infinite, or undetermined between local optima"
        ),
    )
    interval95: Interval | None = Field(
        description=(
            "95 % interval at the mode; null if unidentifiable or held; of a noise factor it is not symmetric"
        )
    )
    prior_std: Number = Field(None, description="standard deviation of the prior")
    midpoint: Number = Field(
        None,
        description=(
            "the paper's fit; null if unidentifiable or held, if that fit failed, and of a noise factor"
        ),
    )
    group: str = Field(description="`offset`, `geometry`, `target`, `tool` or `noise`")
    tolerance_share: Annotated[float, Field(ge=0, lt=1)] | None = Field(
        None,
        description=(
            "of an offset: share of its variance that the tolerances of the geometry set; null for "
            "nominal geometry"
        ),
    )
    reason: str | None = Field(None, description="why it is not `identified`, else null")

    @model_validator(mode="after")
    def _no_more_than_its_status(self) -> Self:
        if self.status == "unidentifiable" and (self.estimate is not None or self.std is not None):
            raise ValueError(f"{self.name} is unidentifiable, yet it has a number")
        if self.std is not None and self.std <= 0:
            raise ValueError(f"the std of {self.name} is not a number above 0")
        if has_numbers(self.status) and None in (self.estimate, self.std, self.interval95):
            raise ValueError(f"{self.name} is {self.status}, yet it lacks a number")
        return self


class WithoutPriorDocument(DocumentPart):
    """The identifiable offsets by the measurements alone."""

    names: tuple[str, ...] = Field(description="of the offsets")
    units: tuple[str, ...] = Field(description="of each")
    values: tuple[float, ...] = Field(description="of each")
    covariance: Rows = Field(description="by the noise, in products of the units")
    geometry: tuple[str, ...] = Field(description="names of the estimated geometry parameters")
    by_geometry: Rows = Field(description="of each offset what each of these adds if it is one tolerance off")
    dof: int | None = Field(description="degrees of freedom of the noise; null where it is known")


class DirectionDocument(DocumentPart):
    """A null-space direction in words."""

    combination: dict[str, float] = Field(
        description=(
            "weights in prior stds, the largest 1, of offsets, targets, a free tool and noise factors; "
            "parameters with a tolerance take part in those of kind `optima` alone"
        )
    )
    kind: Literal["exact", "noise", "optima"] = Field(
        description="`optima`: the way to another local optimum that explains the data about as well"
    )
    reason: str = Field(description="the cause, in words")
    remedy: str = Field(description="what would determine it, in words")
    data_std: Number = Field(description="of the unit combination, in prior stds; null if exact")
    tried: Tried | None = Field(
        None,
        description=(
            "the remedy in numbers, null where none was tried or none helps: `how` (`replace` or `add`: "
            "the posture of the number in `postures`, with `joint`, from 1, rotated by `amount` in `unit` "
            "(deg or mm) and aimed again, in its place or as one more; `vary`: these `postures`, all but "
            "those that stay `unchanged`, with `joint` rotated by −1/2, 1/2 and 0 times the `amount` in "
            "turn, and aimed again; `tolerances`: an `amount` of times smaller), whether these are postures "
            "of what was `measured`, whether there is a beam to be `aimed`, and `predicted`, by parameter: "
            "its `name`, `unit`, standard uncertainty `before` (null where it is not determined) and "
            "`after` the remedy, priors "
            "included, and the `tolerance` up to which it is identified"
        ),
    )


class IdentifiabilityDocument(DocumentPart):
    """Rank, condition and observability of the fit, and its null-space directions."""

    rank: int = Field(
        description=(
            "number of directions in which the data say more than the prior, and of parameters with a "
            "tolerance (geometry, a calibrated tool)"
        )
    )
    size: int = Field(description="number of free parameters")
    condition: Number = Field(
        description=(
            "largest over smallest singular value, the parameters with a tolerance eliminated; null if "
            "singular"
        )
    )
    observability: dict[str, Number] = Field(
        description="`O1` … `O5` of the same singular values; 0 for a singular matrix"
    )
    null_space: tuple[DirectionDocument, ...] = Field(description="the undetermined directions")


class FitDocument(DocumentPart):
    """One of the two fits, null where it does not define a number."""

    available: bool = Field(True, description="false where the cost is not defined for these data")
    converged: bool = Field(description="whether it has an answer")
    reason: str = Field(description="termination, in words")
    iterations: int | None = Field(None, description="how many")
    cost: Number = Field(None, description="at the end")
    rms_mm: Number = Field(None, description="of the residuals in lengths, millimetres")
    rms_before_mm: Number = Field(None, description="the same without any offset, millimetres")
    rms_deg: Number = Field(None, description="of the angles that a pose has, degrees")
    rms_before_deg: Number = Field(None, description="the same without any offset, degrees")
    chi2: Number = Field(description="of the normalised residuals")
    dof: int | None = Field(description="degrees of freedom")
    p_value: Number = Field(
        description="of χ²; null where the noise is estimated or no degree of freedom is left"
    )
    p_small: Number = Field(
        None,
        description=(
            "p-value of residuals as small, the noise as stated, of an arm without any deviation; null where "
            "the noise is estimated, and without an answer"
        ),
    )
    noise_scale: Number = Field(
        description="the noise as a multiple of the stated one, where it is estimated"
    )
    other_basins: int = Field(0, description="number of other local optima")
    message: str | None = Field(None, description="what else is to be known, in words")


class FitsDocument(DocumentPart):
    """The likelihood fit and the paper's."""

    likelihood: FitDocument = Field(description="of the likelihood: the answer")
    midpoint: FitDocument = Field(description="of the paper (eq. 8)")


class ToleranceDocument(DocumentPart):
    """Tolerances of the links."""

    length_mm: Tolerance = Field(description="of each length, millimetres: a number or a list")
    angle_deg: Tolerance = Field(description="of each angle, degrees: a number or a list")


class GeometryDocument(DocumentPart):
    """The geometry: tolerances, the model ladder, what the offsets are worth with nominal geometry."""

    tolerance: ToleranceDocument | None = Field(
        description="as the header states it; null without the key `geometry`: the geometry is then nominal"
    )
    considered_tolerance: ToleranceDocument = Field(
        description="the same, or 0.3 mm and 0.1° of all links where the header states none"
    )
    factors: Factors | None = Field(
        description=(
            "with `scale: estimated` by what the data multiply the tolerances: `length`, `angle`, and "
            "`log_u`, the standard uncertainty of the logarithm of each; else null"
        )
    )
    ladder: tuple[Rung, ...] = Field(
        description=(
            "the models that were tried, empty for nominal geometry: `rung` (`offsets`: nominal geometry; "
            "`geometry`; `gravity`; `harmonics`), `parameters` (how many are free), `held_out_rms_mm` (of "
            "the residuals at placements that the model has not seen; null with one placement), "
            "`log_evidence`, `kept`"
        )
    )
    consider: dict[str, Number] = Field(
        description=(
            "by offset name, the standard uncertainty if the offset is estimated with nominal geometry "
            "and the arm has the considered tolerances (consider analysis); null where the offset is "
            "unidentifiable"
        )
    )
    at_half: dict[str, Number] = Field(
        description=(
            "by offset name, what `std` would be at half the tolerances; empty for nominal geometry; null "
            "where the model does not describe the data"
        )
    )
    at_twice: dict[str, Number] = Field(description="the same at twice the tolerances")
    confounded: tuple[Confounded, ...] = Field(
        description=(
            "of each `offset` the geometry parameter, and the `parameter` of a free tool, with which it "
            "has the largest `correlation`; empty for nominal geometry. The parameter itself may be "
            "unidentifiable"
        )
    )


class PosteriorMessage(DocumentPart):
    """What is read back of the posterior."""

    converged: bool = Field(description="whether the draws may be used")
    message: str | None = Field(description="why there are none, or why not, in words")


class PosteriorDocument(PosteriorMessage):
    """Diagnostics of the sampling; `parameters` is null unless it converged."""

    draws: int = Field(description="how many")
    ensembles: int = Field(description="independent ones")
    walkers: int = Field(description="of each ensemble")
    ess_min: Number = Field(description="smallest effective sample size")
    rhat_max: Number = Field(description="largest nested R-hat, of the ensembles")
    acceptance: Number = Field(description="share of the proposed moves that were accepted")
    agreement: Agreement | None = Field(
        description=(
            "whether another method confirms the draws, null where they did not get so far: `by` "
            "(`importance`: sampling weighted by the density, or `profile`: the profile likelihood; null "
            "where neither serves), `pareto_k` of the weights and their effective `share`, and `name`, the "
            "parameter whose 95 % interval of draws is off most, by `off` of its width beyond chance. More "
            "than 0.05 is not converged"
        )
    )
    seconds: float = Field(description="that it took")
    parameters: tuple[PosteriorParameter, ...] | None = Field(
        description=(
            "null unless converged; nothing is sampled of a misfit, or where no parameter is "
            "identifiable. A list of `name`, `unit`, `source` (`data`, or `prior` for an unidentifiable "
            "parameter: the numbers are then those of its own prior), `mean`, `std`, `q2_5`, `q50`, "
            "`q97_5`, `ess_bulk`, `ess_tail`, `rhat`, `mcse_mean`"
        )
    )


class IntervalsDocument(DocumentPart):
    """The 95 % intervals of a parameter by three methods."""

    name: str = Field(description="of an offset, tool or noise parameter")
    unit: str = Field(description="of its ends")
    linear: Interval = Field(description="the `interval95` of the parameter, by the curvature at the mode")
    profile: Interval | None = Field(description="by the profile likelihood; null where an end was not found")
    posterior: Interval | None = Field(
        description="between the quantiles of the draws; null without a posterior"
    )
    differ: bool = Field(description="whether an end is off by a tenth of the width or more")


class AccuracyDocument(DocumentPart):
    """The accuracy at the TCP over the workspace."""

    point_mm: tuple[float, float, float] = Field(description="the TCP in the flange frame, millimetres")
    place: str = Field(description="its description")
    workspace: Region | None = Field(
        description=(
            "over the limits of the joints: `postures`, and each as `median` and `worst` `before_mm` "
            "(error with nothing entered), `before_std_mm` (its std at those two postures), `after95_mm` "
            "(radius that contains the error with 95 % probability once the values of `enter` are "
            "entered), `after_rms_mm` (expected error); null where no accuracy is claimed"
        )
    )
    near_shots: Region | None = Field(
        description="the same over the ranges that the joints of the measurements span"
    )
    maps: tuple[Map, ...] = Field(
        description=(
            "two of the workspace, none where no accuracy is claimed: `plane` (`vertical`, `horizontal`), "
            "`axes`, `cell_mm`, `corner_mm` (lowest corner), and grids, rows from below: `postures` and "
            "`shots` (counts), `before_mm` and `after95_mm` (each `median` and `worst`; null where no "
            "posture falls)"
        )
    )
    undetermined: tuple[str, ...] = Field(
        description="offsets that the TCP depends on and that are unidentifiable or held; empty otherwise"
    )
    weak: tuple[str, ...] = Field(description="offsets that enter with a large std")
    sensitivity_mm2: Rows | None = Field(
        description=(
            "a matrix S, a row and a column for each joint: errors d of the offsets (in their units) move "
            "the TCP by √(d′ S d) mm, root mean square over the workspace; null where no accuracy is "
            "claimed"
        )
    )
    reason: str | None = Field(description="why there is no number, else null")


class BudgetDocument(DocumentPart):
    """The uncertainty budget of a parameter."""

    name: str = Field(description="of an identifiable offset or tool parameter")
    unit: str = Field(description="of its numbers")
    std: float = Field(description="combined standard uncertainty")
    rows: tuple[BudgetRow, ...] = Field(
        description=(
            "the sources: the squares of `contribution` (with its sign) add up to `std` squared. `kind` "
            "and `of`: `joint` (its number), `spot`, `prior` (the parameter), `target` (its three "
            "coordinates), `distance` (the two targets), `noise factors` (their effect on the weights), "
            "`curvature` (of the log-posterior beyond Fisher's information). `type`: `A` (from the "
            "residuals of this run) or `B` (stated); `std` of one reading or stated number, with its "
            "`unit` and `dof` (null: infinite); all null for the last two kinds. `sensitivity`: "
            "contribution over std, in the unit of the parameter per `unit`, all readings together; null "
            "where there is no std. `contribution`: a std in the unit of the parameter, negative where it "
            "lowers the variance. `share`: of the variance"
        )
    )
    dof: Number = Field(description="effective degrees of freedom; null: infinite")
    coverage_factor: float = Field(description="k for 95 %")
    expanded: float = Field(description="k times `std`")
    check: LinearCheck | None = Field(
        description=(
            "against the posterior (JCGM 101, clause 8), null without one: `digits` (2, or 1 where the "
            "Monte Carlo error is too large for 2), `tolerance`, `d_low`, `d_high` (differences of the "
            "ends), `ends_std` (Monte Carlo standard error of the posterior's ends), `validated` (null: "
            "inconclusive, Monte Carlo error too large)"
        )
    )


class RobustParameterDocument(DocumentPart):
    """A parameter by the robust fit."""

    name: str = Field(description="of the parameter")
    unit: str = Field(description="of its numbers")
    estimate: Number = Field(description="null where it is unidentifiable")
    std: Number = Field(
        description=(
            "by a sandwich covariance, from the residuals as they are; null where it is unidentifiable, "
            "and with a measurement of leverage 1"
        )
    )
    interval95: Interval | None = Field(description="by the same covariance; null likewise")


class RobustDocument(DocumentPart):
    """The robust fit."""

    loss: Loss = Field(description="the loss function")
    tuning: float = Field(
        description=(
            "of `huber` the normalised residual beyond which the weight falls; of `student` the degrees "
            "of freedom"
        )
    )
    converged: bool = Field(description="whether the weights converged; if not, no parameter has a number")
    reason: str = Field(description="termination, in words")
    noise_scale: Number = Field(
        description=(
            "the noise as a multiple of the stated one, from the median residual; null unless "
            "`noise.scale: estimated`"
        )
    )
    parameters: tuple[RobustParameterDocument, ...] = Field(description="by the robust fit")
    weights: tuple[float, ...] = Field(
        description=(
            "of the measurements, in the order of `shots`: with 1 a measurement counts as in the "
            "likelihood fit (Student: a little more than 1 for a small residual)"
        )
    )
    outliers: tuple[int, ...] = Field(
        description="numbers of the outlying measurements, the largest residual first"
    )
    message: str | None = Field(description="the same in words")


class HoldOutDocument(DocumentPart):
    """Placements held out."""

    targets: tuple[str, ...] = Field(description="names of the held-out targets")
    placements: tuple[str, ...] = Field(description="names of the held-out placements")
    shots: int = Field(description="number of their measurements")
    shots_fitted: int = Field(description="number of the measurements that were fitted")
    rms_mm: Number = Field(
        description="of the residuals there, with the offsets of the other measurements, millimetres"
    )
    rms_before_mm: Number = Field(description="the same without any offset, millimetres")
    expected_mm: Number = Field(
        description="`rms_mm` as expected from the noise and the uncertainty of the fit, millimetres"
    )
    chi2: Number = Field(description="of these residuals against the noise and the uncertainty of the fit")
    dof: int | None = Field(description="degrees of freedom")
    p_value: Number = Field(description="of χ²")
    message: str | None = Field(description="why there is no test, or null")


class PredictedRunDocument(DocumentPart):
    """Another run as the fit predicts it."""

    run: str = Field(description="name of the other run")
    sha256: str = Field(description="of the other run")
    targets: tuple[str, ...] = Field(description="of another run: its targets")
    targets_placed: tuple[str, ...] = Field(
        description=(
            "targets that only the other run has: their positions are estimated from it, and the "
            "components of the residuals that this takes up do not count"
        )
    )
    shots: int = Field(description="of another run: number of its measurements")
    shots_fitted: int = Field(description="of another run: number of the measurements of the analysed run")
    unknown: tuple[int, ...] = Field(
        description=(
            "numbers of the measurements whose prediction the data do not determine: its u is more than "
            "10 times their noise. They are in no other number"
        )
    )
    taken_up: tuple[int, ...] = Field(
        description=(
            "numbers of the measurements of a target that has no more numbers than coordinates: there is "
            "no prediction"
        )
    )
    rms_mm: Number = Field(
        description=(
            "of another run: of the errors of the prediction, the lengths of the residuals at the joint "
            "positions as recorded"
        )
    )
    median_mm: Number = Field(description="of the same errors, millimetres")
    max_mm: Number = Field(description="of the same errors, millimetres")
    rms_before_mm: Number = Field(
        description=(
            "of another run: with nominal joints and links, targets and free tool fitted to the analysed "
            "run, millimetres; null where that fit did not converge"
        )
    )
    median_before_mm: Number = Field(description="likewise, millimetres")
    max_before_mm: Number = Field(description="likewise, millimetres")
    expected_mm: Number = Field(
        description="of another run: `rms_mm` as expected from the noise and `u_mm`, millimetres"
    )
    u_mm: Number = Field(
        description=(
            "root mean square of the standard uncertainties of the predictions, without the noise, "
            "millimetres"
        )
    )
    chi2: Number = Field(description="of these residuals against the noise and the uncertainty of the fit")
    dof: int | None = Field(description="degrees of freedom")
    p_value: Number = Field(description="of χ²")
    measurements: tuple[PredictedMeasurement, ...] = Field(
        description=(
            "of the other run: `shot`, `target`, `error_mm`, `before_mm`, `expected_mm` (null where there "
            "is no prediction) and `u_mm`"
        )
    )
    message: str | None = Field(description="why there is no test, or null")


class LeftOutDocument(DocumentPart):
    """A placement as the others predict it."""

    placement: str = Field(description="its name")
    shots: int = Field(description="number of its measurements")
    rms_mm: Number = Field(description="of its residuals by the fit without it, millimetres")
    expected_mm: Number = Field(
        description="`rms_mm` as expected from the noise and the uncertainty of the fit, millimetres"
    )
    factor: Number = Field(description="the root of chi-squared over its degrees of freedom")
    chi2: Number = Field(description="of these residuals")
    dof: int | None = Field(description="degrees of freedom")
    p_value: Number = Field(description="of χ²")
    message: str | None = Field(description="why there is no test, or null")


class EffectiveDocument(DocumentPart):
    """The effective number of measurements."""

    recordings: tuple[RecordingCorrelation, ...] = Field(
        description=(
            "consecutive measurements of one target: `target`, `first_shot`, `last_shot`, `shots`, `rho` "
            "(lag-1 correlation of the normalised residuals, without bias; null where the measurements do "
            "not determine it to ±0.5 with 95 %, or it is beyond ±0.98), `kappa` ((1 + ρ) / (1 - ρ)), "
            "`p_value` (one-sided; null with fewer than four measurements)"
        )
    )
    shots: int = Field(description="number of all measurements")
    rho: Number = Field(description="of all recordings together")
    kappa: Number = Field(description="likewise")
    p_value: Number = Field(description="likewise")
    divisor: float = Field(description="1 without clear evidence of a correlation")
    number: float = Field(description="`shots` / `divisor`: the effective number of measurements")


class PlacementsDocument(DocumentPart):
    """Placements left out in turn, the jackknife, correlation and steps of the recordings."""

    names: tuple[str, ...] = Field(description="of the placements")
    leave_one_out: tuple[LeftOutDocument, ...] = Field(
        description="each placement by the fit without it; empty with one placement"
    )
    leave_one_out_rms_mm: Number = Field(description="over the measurements of all placements, millimetres")
    leave_one_out_expected_mm: Number = Field(description="likewise, millimetres")
    jackknife: dict[str, Number] | None = Field(
        description=(
            "by offset name, the standard uncertainty by the delete-one-placement jackknife, in the unit "
            "of the offset; null where the offset is unidentifiable without one of the placements. No "
            "unidentifiable or held offset is in it. Null with fewer than three placements"
        )
    )
    jackknife_dof: int | None = Field(description="the number of placements less 1")
    jackknife_needs: dict[str, tuple[str, ...]] | None = Field(
        description="by offset name, the placements without which it is unidentifiable"
    )
    effective: EffectiveDocument = Field(description="correlation of the measurements")
    steps: tuple[RecordingStep, ...] = Field(
        description=(
            "significant steps inside recordings, the clearest first: `target`, `first_shot`, "
            "`last_shot`, `shots` (how many), `shift_mm` (of the target against the rest of the "
            "recording, base frame; null for an undetermined component), `size_mm`, `p_value` "
            "(Holm-adjusted over the recordings; below 0.01), `station` (whether it is an instrument that "
            "stands in the world), `factor` (the root mean square of the shifted residuals over that of "
            "the others; a misfit from 2 on, if the p-value is below 0.001)"
        )
    )
    steps_tested: int = Field(description="number of recordings that are long enough to be tested")


class ExplanationDocument(DocumentPart):
    """What explains a misfit."""

    cause: Cause = Field(description="its name")
    joints: tuple[int, ...] = Field(description="from 1")
    targets: tuple[str, ...] = Field(description="names")
    measurements: tuple[int, ...] = Field(
        description="their numbers; of a moved target the last before and the first after"
    )
    factor: float = Field(description="the residual over the stated noise that it leaves")
    agrees: bool = Field(description="whether that agrees with the noise")
    odds: float = Field(description="its evidence over that of the best explanation: 1 of the first")
    readings: tuple[Misreading, ...] = Field(
        default=(),
        description="of a single measurement: the values of which one alone, if it is wrong, explains it, the"
        " likeliest first, each within 20 : 1 of it. `joint` from 1; `fitted`, with the standard uncertainty"
        " `u`, agrees with the other measurements; `meant` differs from `recorded` by one slip, or null",
    )
    sentence: str = Field(description="the same in words")


class EnterDocument(DocumentPart):
    """Values to enter, and the error of the TCP to expect."""

    for_: TakenGeometry = Field(
        alias="for",
        description=(
            "the geometry that takes the values: that of a controller, or that of a file with links"
        ),
    )
    values: dict[str, float] = Field(
        description=(
            "by offset, degrees or millimetres: the least expected squared error of flange and TCP in "
            "front of the arm; the estimates for `geometry`, and of an arm that is taken as exact"
        )
    )
    u: dict[str, float] = Field(
        description=(
            "the standard uncertainty of each: how far it may be from the value that would serve this arm "
            "best"
        )
    )
    tcp_before: TcpError | None = Field(
        description=(
            "`median_mm` and `p95_mm` of the TCP's error over postures and posterior with nothing "
            "entered, and `median_band_mm`, 95 % of this arm's median; null where the TCP depends on an "
            "offset that is not determined"
        )
    )
    tcp_after: TcpError | None = Field(description="the same with the values entered")
    worse: Number = Field(
        description=(
            "the probability that the TCP's error, root mean square, is larger with them than with "
            "nothing entered; above 0.05 it is a caution"
        )
    )


class PowerDocument(DocumentPart):
    """The probability with which a run notices a wrong model."""

    wrong: WrongModel = Field(
        description=(
            "`tool`: a point of the tool is off by `size`, where the tool has a `sigma`, in the direction "
            "that does most harm of those that are not noticed; `beam`: the direction of a calibrated "
            "laser; `jump`: the zero of `joint`, chosen likewise, jumps halfway; `drift`: the zero of "
            "`joint`, from the first measurement to the last; `backlash`: every joint is off by that, one "
            "way or the other; `noise`: readings scatter so many times as much; `arm`: the geometry is so "
            "many times its tolerance off; `moved`: a target, halfway through its measurements or "
            "steadily; `reading`: one measurement at the spot"
        )
    )
    size: float = Field(description="of the wrong thing")
    unit: str = Field(description="of `size`")
    joint: int | None = Field(description="from 1, else null")
    probability: float = Field(description="that a run detects it")
    off_u: float = Field(description="the largest error of an offset by it, in the offset's u")
    risk: float = Field(
        description=(
            "the probability that a run passes with an offset wrong by more than 4 u, the largest over "
            "all sizes"
        )
    )
    worst_size: Number = Field(description="that size")
    dangerous: bool = Field(description="whether `risk` is above 0.01")


class SizeDocument(DocumentPart):
    """How far something may be off: a standard deviation."""

    std: float | tuple[float, ...] = Field(description="standard deviation; of links a list, one for each")
    unit: str = Field(description="`deg` or `mm`")


class BasisDocument(DocumentPart):
    """What is taken as known besides the measurements."""

    of: str = Field(description="label of the instrument, `tool`, or `arm`")
    kind: str = Field(description="of the instrument, or `arm`")
    part: str = Field(description="`mounting`, `tip`, `frame`, `mount`, `links`, or the name of a reflector")
    stated: bool = Field(description="whether the header says how well it is known; else that is assumed")
    keys: tuple[str, ...] = Field(description="the keys of the header that say so")
    sizes: tuple[SizeDocument, ...] = Field(
        description="how well it is known, a list of `std` and `unit`; empty: it is taken as exact"
    )
    offset: str | None = Field(description="the offset to which it does most, else null")
    unit: str | None = Field(description="of `u`")
    u: Number = Field(description="standard uncertainty of that offset")
    u_if_exact: Number = Field(description="the same, were it known exactly")


class ResultDocument(DocumentPart):
    """The content of a result.json, in the order of its keys."""

    schema_: Literal["zerobeam/result/1"] = Field(alias="schema")
    verdict: Verdict = Field(
        description=(
            "over all offsets; where the model does not describe the measurements, every parameter that the "
            "data determine has the status `unvalidated`"
        )
    )
    message: Message = Field(
        description=(
            "what report, terminal, Python and app show first, in sentences: `verdict` (of a pass with "
            "what it is subject to; with U and its coverage factor k; `Simulated:` of a simulated run), "
            "`worst` (the least well determined offset: `name`, `value`, its expanded uncertainty U, null "
            "where it is not determined, `unit`, `text`; null for a misfit), `cause` (of a misfit its "
            "best explanation, of a degenerate run the mechanism, of a weak one the limit, of a pass the "
            "evidence against it; else null), `action` (`text`, and `command`, the command to type, or "
            "null), `cautions` (the gravest first), `basis` (what was stated, and what was assumed with what "
            "it does to U), `grade` (`pass`, `weak`, `degenerate`, `misfit`, `held`: how it is coloured; a "
            "pass that something speaks against is `weak`, one of a simulated run `held`), `may` (`enter`, "
            "`certify`, `export`: what may be done with it). Of a misfit it has nothing that follows from "
            "the wrong model"
        )
    )
    coverage_factor: float = Field(
        description=(
            "k of every expanded uncertainty U = k u: 2, or Student's factor where the noise scale is "
            "estimated and that is larger"
        )
    )
    headline: str = Field(description="the verdict in a sentence")
    parameters: tuple[ParameterDocument, ...] = Field(description="a row each")
    without_prior: WithoutPriorDocument | None = Field(
        description="the identifiable offsets by the measurements alone, null where there is none"
    )
    identifiability: IdentifiabilityDocument = Field(description="rank, condition, null space")
    fits: FitsDocument = Field(description="null where a fit does not define a number")
    geometry: GeometryDocument = Field(
        description="tolerances, the model ladder, and the offsets with nominal geometry"
    )
    posterior: PosteriorDocument = Field(description="of the sampling")
    shots: tuple[ShotResult, ...] = Field(
        description=(
            "the measurements, a list of `shot`, `target`, `miss_mm` (residual: the lengths that were "
            "read), `miss_deg` (the angles, empty without any), `length_mm` (length of `miss_mm`; of "
            "several readings their root mean square), `whitened` (length of the normalised residual), "
            "`leave_one_out` (length in mm of the leave-one-out residual, by a fit without the "
            "measurement, of more than 300 measurements by one Newton step; null at leverage 1, or if "
            "that fit failed), `cooks` (Cook's distance, by the same fit; null likewise)"
        )
    )
    distances: tuple[DistanceResult, ...] = Field(
        description="a list of `between`, `mm`, `sigma_mm`, `estimate`, `std`"
    )
    angles: tuple[AngleResult, ...] = Field(
        description="a list of `between`, `deg`, `sigma_deg`, `estimate`, `std` (degrees)"
    )
    intervals: tuple[IntervalsDocument, ...] = Field(
        description=(
            "the 95 % intervals by three methods, of offsets, tool and noise that are weak or where two "
            "methods differ"
        )
    )
    accuracy: AccuracyDocument = Field(
        description="of the TCP over the workspace, with nothing and with the values of `enter` entered"
    )
    budget: tuple[BudgetDocument, ...] = Field(
        description=(
            "the uncertainty budget by the GUM of each identifiable offset and tool parameter; empty "
            "where the fit did not converge"
        )
    )
    robust: RobustDocument | None = Field(description="of `--robust`, else null")
    hold_out: HoldOutDocument | PredictedRunDocument | None = Field(
        description=(
            "of `--hold-out`, else null; its numbers are null where there is no test: the fit did not "
            "converge, or a target has no more numbers than coordinates"
        )
    )
    placements: PlacementsDocument = Field(
        description=(
            "each placement as the others predict it, the jackknife, correlation and steps of the recordings"
        )
    )
    scene: RunScene | None = Field(
        description=(
            "content of the 3D picture, null where the fit did not converge: `shots` (at most 60, evenly "
            "over the run), `targets`, `radius2` (squared radius in standard deviations of the 95 % "
            "ellipsoid of a position: 7.815, or 3 F(3, dof) where the noise scale is estimated). A "
            "measurement: `shot`, `target`, `links` (points from the base over joints and flange to laser "
            "or tip, mm, base frame), `beam_to` (the point of the beam nearest to the target, null for a "
            "probe), `ahead` (false: the laser points away), `sights` (lines to what other instruments "
            "measure, two points each). `outlines`: of planes and balls `target` and `lines`. A target: "
            "`name`, `at_mm` (null: unidentifiable), `covariance_mm2` (3 × 3, null if unidentifiable or "
            "held). Unidentifiable offsets and tool parameters are shown at their prior means"
        )
    )
    misfit: MisfitDocument | None = Field(
        description="null, or why the model does not describe the measurements"
    )
    diagnosis: tuple[ExplanationDocument, ...] = Field(
        description=(
            "what explains a misfit, the best explanation first, empty where nothing does or there is none"
        )
    )
    enter: EnterDocument | None = Field(
        description=(
            "the values that serve a controller with nominal geometry best, null where nothing may be "
            "entered (`next_steps.enter` is empty)"
        )
    )
    enter_geometry: EnterDocument | None = Field(
        description=(
            "the same for what takes the links too (`export robot`, `urdf`): the estimates of the offsets "
            "and links that are determined. Null of an exact arm"
        )
    )
    conformity: Conformity | None = Field(
        description=(
            "null without `required` in the header, or without `enter`: `required_mm`, `tcp_95_mm` (what "
            "95 % of the workspace stays below with the values of `enter`, the middle of its posterior), "
            "`probability` (that it is within the requirement), `decision` (`conforms`, `does not "
            "conform`, `undecided`), `rule`"
        )
    )
    power: tuple[PowerDocument, ...] = Field(
        description=(
            "the probability with which such a run detects each wrong model, at the estimates. A pass is "
            "subject to the absence of each that is `dangerous`, and `message.verdict` says so; empty "
            "where nothing is tested, and of a misfit"
        )
    )
    taken_as_known: tuple[BasisDocument, ...] = Field(
        default=(),
        description=(
            "what the answer takes as known of tool, instruments and links besides the measurements, whether "
            "the header states it or it is assumed"
        ),
    )
    notes: tuple[str, ...] = Field(description="findings in sentences, the gravest first")
    next_steps: NextSteps = Field(
        description=(
            'the first page\'s "What to do": `enter`, the values to enter in the controller (`name`, '
            "`value`, `expanded_u`, and `estimate`, the offset of the arm; rounded texts), empty unless "
            "the verdict is `pass` and nothing speaks against it; `steps`, a list of `text` and "
            "`commands`, the first of them the `action` of `message`"
        )
    )
    inputs: Inputs = Field(
        description=(
            "`run`, `sha256`, `robot`, `shots`, `targets`, `seed`, `versions`, `header`, `vendor` (of the "
            "robot, null where its file states none)"
        )
    )


class CheckedParameterDocument(DocumentPart):
    """A row of the `parameters` of a check."""

    name: str = Field(description="of the parameter")
    unit: str = Field(description="as in a result")
    group: str = Field(description="`offset`, `geometry`, `target`, `tool` or `noise`")
    status: Status = Field(description="what the data will determine")
    held: bool = Field(description="whether it is not estimated")
    data_std: Number = Field(
        description=(
            "predicted standard uncertainty without prior; null for an infinite one (an exact gauge) and "
            "for a held parameter"
        )
    )
    std: Number = Field(
        description=(
            "of measurements and prior together; null for an unidentifiable parameter, where it would be "
            "the prior's, and for a held one"
        )
    )
    prior_std: float = Field(description="standard deviation of the prior")
    tolerance_share: Number = Field(description="as in a result")
    reason: str | None = Field(description="why it is not `identified`, else null")


class CheckDocument(DocumentPart):
    """What `zerobeam check --json` prints, in the order of its keys."""

    schema_: Literal["zerobeam/check/1"] = Field(alias="schema")
    verdict: Literal["pass", "weak", "degenerate", "violated"] = Field(
        description="`violated` where a posture breaks a constraint of the plan"
    )
    headline: str = Field(description="the same in a sentence")
    parameters: tuple[CheckedParameterDocument, ...] = Field(description="a row each")
    identifiability: IdentifiabilityDocument = Field(description="as in a result")
    power: tuple[PowerDocument, ...] = Field(
        description=(
            "the power of the χ² of a run against wrong models, as in a result. Empty where the noise is "
            "estimated, or no degree of freedom is left"
        )
    )
    geometry: GeometryDocument = Field(
        description=(
            "as in a result: what the offsets will be worth if the arm deviates from nominal geometry"
        )
    )
    postures: tuple[CheckedPosture, ...] = Field(
        description=(
            "a list of `posture` (from 0), `target`, `off_mm` (distance from the target before the wrist "
            "was rotated), `hit` (whether the wrist can bring the beam onto the target), `violations`: a "
            "list of `posture` (from 0), `constraint` (`acceptance_deg`, `beam_mm`, `margin_deg`, "
            "`obstacles`, `instrument`: it cannot measure there), `condition` (`facing`, `beam_mm`, "
            "`limits`: too near to a joint limit, `itself`: the arm touches itself, `cell`: the floor or "
            "a box, `beam`: a box is in its way, `sight`: a box is in the line of sight, `arm`: a link of "
            "the arm is in the way of either: `at` from its axis, `lowest` its radius, which is `assumed` "
            "where nothing states it, `unfit`: `why`, a clause, is null else), the value `at`, `lowest` and "
            "`highest` allowed, in `unit` (null for what is touched), `joint` (from 1; of `arm` the link "
            "that it moves, 0 the base), `via` (from 0: an intermediate posture "
            "before the posture), `planned` (broken by the posture as written, not with the wrist rotated "
            "onto the target)"
        )
    )
    curve: tuple[CurvePoint, ...] = Field(
        description=(
            "a list of `shots` (2, 3, …, in the plan's order) and `worst_std` (the largest std of an "
            "offset with that many measurements, priors included)"
        )
    )
    over_target: OverTarget | None = Field(
        description=(
            "the plan with its targets at random positions by their `sigma_mm`: `draws` (how many "
            "positions), `hit` (share of the postures that can be rotated onto them), `worst_std` (of "
            "each offset, the largest over the positions), `mounts`: also with reflectors, mounts and tips "
            "at random places on the flange, by their sigma, of 50 mm and 30° where they are only guessed; "
            "null where no target has both `guess_mm` and `sigma_mm` and no such place is open. With "
            "`mounts` every predicted `std` is that at a typical place: the one whose std are nearest to "
            "the root mean squares over 256"
        )
    )
    advice: Advice | None = Field(
        description=(
            "the single change of the plan that lowers the largest std most: change `posture` (from 0) in "
            "`joint` (from 1) by `change_deg` (mm if prismatic; `unit`) and aim it again, as one more "
            "measurement (`add` true) or in its place; `worst_std_before` (null where an offset is not "
            "determined), `worst_std_after`. Null where the verdict is `pass` or no single change helps much"
        )
    )
    notes: tuple[str, ...] = Field(description="findings in sentences, violations first")
    inputs: PlanInputs = Field(description="`plan`, `sha256`, `robot`, `versions`")


class _ReadFits(DocumentPart):
    likelihood: FitDocument


class _ReadAccuracy(DocumentPart):
    point_mm: ReadPoint | None = None
    sensitivity_mm2: Rows | None = None


class _ReadSceneShot(DocumentPart):
    shot: int
    links: tuple[ReadPoint, ...]
    beam_to: ReadPoint | None


class _ReadScene(DocumentPart):
    shots: tuple[_ReadSceneShot, ...]


class _ReadMisfit(DocumentPart):
    criteria: tuple[SentenceDocument, ...]


class ReadResult(DocumentPart):
    """What is read back of a result; earlier versions lack what is optional here."""

    verdict: Verdict
    message: Message | None = None
    coverage_factor: float = 2.0
    headline: str
    parameters: tuple[ParameterDocument, ...]
    without_prior: WithoutPriorDocument | None = None
    fits: _ReadFits
    posterior: PosteriorMessage
    shots: tuple[ShotResult, ...]
    accuracy: _ReadAccuracy | None = None
    scene: _ReadScene | None = None
    misfit: _ReadMisfit | None = None
    diagnosis: tuple[SentenceDocument, ...] = ()
    notes: tuple[str, ...]
    next_steps: NextSteps | None = None
    conformity: Conformity | None = None
    inputs: Inputs

    @property
    def offsets(self) -> tuple[ParameterDocument, ...]:
        """The rows of the joint offsets."""
        return tuple(row for row in self.parameters if row.group == "offset")

    @model_validator(mode="after")
    def _no_contradiction(self) -> Self:
        if self.verdict != "pass" and self.next_steps is not None and self.next_steps.enter:
            raise ValueError(f"the verdict is {self.verdict}, yet there are values to enter")
        if (self.verdict == "misfit") != (self.misfit is not None):
            raise ValueError(f"the verdict is {self.verdict}, and `misfit` says otherwise")
        for key in ("provenance", "noise", "tool"):
            if not isinstance(self.inputs.header.get(key, {}), dict):
                raise ValueError(f"inputs.header.{key} is no mapping")
        return self


class _Kind(DocumentPart):
    schema_: str | None = Field(default=None, alias="schema")


def from_json(text: str) -> ReadResult:
    """What a result.json says. ValueError says what is wrong where it is none, not whole, or contradicts
    itself."""
    if _SURROGATE.search(text):  # which pydantic refuses, although JSON may have one alone
        text = _ALONE.sub("\ufffd", json.dumps(json.loads(text), ensure_ascii=False))
    try:
        schema = _Kind.model_validate_json(text).schema_
        if schema != RESULT_SCHEMA:
            raise ValueError(f"schema {shown(schema)}")
        return ReadResult.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}".removeprefix(": ")) from None
    except UnsoundResult as error:
        raise ValueError(str(error)) from None
