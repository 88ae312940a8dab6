"""The documents of a result (`result.json`) and of a check: the one place that knows their keys.

`ResultDocument` is what is written, `from_json` what is read back of it. Sentences come from `words`. JSON
has no NaN and no infinity: such a number is an error, never a quiet null.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ...model.files.json_document import keys_of
from ...model.parsing.reading import shown
from ..diagnostics.accuracy import Map, Region
from ..diagnostics.budget import BudgetRow, LinearCheck
from ..diagnostics.cause import Cause
from ..diagnostics.enter import Conformity, TakenGeometry, TcpError
from ..diagnostics.influence import ShotResult
from ..diagnostics.predicted_run import PredictedMeasurement
from ..diagnostics.scene import RunScene
from ..estimation.robust import Loss
from ..estimation.tolerance_factors import Factors
from ..misfit import Geometry, OffPrior
from ..observability.changes import How
from ..observability.check import CheckedPosture, PlanInputs, PlanVerdict
from ..observability.geometry import Confounded, Rung, Tolerance
from ..observability.outlook import Advice, CurvePoint, OverTarget
from ..observability.power import WrongModel
from ..posterior.posterior import PosteriorParameter
from ..recordings.recordings import RecordingCorrelation
from ..recordings.steps import RecordingStep
from ..status import Status, UnsoundResult, Verdict, known
from .message import Message
from .result import RESULT_SCHEMA, AngleResult, DistanceResult, Inputs, NextSteps

Interval = tuple[float, float]
Rows = tuple[tuple[float, ...], ...]
Number = float | None
ReadPoint = tuple[float, float, float]
_SURROGATE = re.compile(r"\\u[dD][89abAB]")
_ALONE = re.compile("[\ud800-\udfff]")


class DocumentPart(BaseModel):
    """Part of a document. Types are held to when it is read, and keys of other versions are left out."""

    model_config = ConfigDict(
        strict=True,
        extra="ignore",
        frozen=True,
        allow_inf_nan=False,
        defer_build=True,
    )

    @classmethod
    def filled(cls, value: object, **others: Any) -> Self:
        """With the attributes of `value` of the same names; `others` are its other keys."""
        return cls.model_construct(**keys_of(cls, value, others))

    def to_json(self) -> dict[str, Any]:
        """As dicts, lists, strings, bools, ints and finite floats; UnsoundResult names what is neither."""
        answer = _keys(self)
        try:
            plain: dict[str, Any] = json.loads(json.dumps(answer, allow_nan=False))
        except TypeError as error:
            raise _unsound(str(error)) from None
        except ValueError:  # which does not say where
            where, number = next(_not_finite(answer))
            raise _unsound(f"{where} is {number}, not a number") from None
        return plain


def _keys(value: object) -> object:
    """Parts of a document and dataclasses as dicts. `model_dump` gives the same, but builds a serializer of
    the whole document first: that takes as long as three figures."""
    if isinstance(value, DocumentPart):
        names = {name: field.alias or name for name, field in type(value).model_fields.items()}
        return {names[name]: _keys(item) for name, item in value if name in value.model_fields_set}
    if is_dataclass(value):
        return {field.name: _keys(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, dict):
        return {name: _keys(item) for name, item in value.items()}
    return [_keys(item) for item in value] if isinstance(value, list | tuple) else value


def _unsound(what: str) -> UnsoundResult:
    return UnsoundResult(f"the result is unsound and was not written: {what}")


def _not_finite(value: object, where: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, float) and not math.isfinite(value):
        yield where, value
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _not_finite(item, f"{where}.{key}".lstrip("."))
    elif isinstance(value, list | tuple):
        for i, item in enumerate(value):
            yield from _not_finite(item, f"{where}[{i}]")


class ParameterDocument(DocumentPart):
    """A row of `parameters`: an offset has `tolerance_share` too."""

    name: str
    unit: str
    status: Status
    held: bool
    estimate: Number
    std: Number
    data_std: Number = None
    interval95: Interval | None
    prior_std: Number = None
    midpoint: Number = None
    group: str
    tolerance_share: Annotated[float, Field(ge=0, lt=1)] | None = None
    reason: str | None = None

    @model_validator(mode="after")
    def _no_more_than_its_status(self) -> Self:
        if self.status == "unidentifiable" and (self.estimate is not None or self.std is not None):
            raise ValueError(f"{self.name} is unidentifiable, yet it has a number")
        if self.std is not None and self.std <= 0:
            raise ValueError(f"the std of {self.name} is not a number above 0")
        if known(self.status) and None in (self.estimate, self.std, self.interval95):
            raise ValueError(f"{self.name} is {self.status}, yet it lacks a number")
        return self


class WithoutPriorDocument(DocumentPart):
    """The identifiable offsets by the measurements alone."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    covariance: Rows
    geometry: tuple[str, ...]
    by_geometry: Rows
    dof: int | None


class DirectionDocument(DocumentPart):
    """A null-space direction in words."""

    combination: dict[str, float]
    kind: Literal["exact", "noise", "optima"]
    reason: str
    remedy: str
    data_std: Number


class IdentifiabilityDocument(DocumentPart):
    """Rank, condition and observability of the fit, and its null-space directions."""

    rank: int
    size: int
    condition: Number
    observability: dict[str, Number]
    null_space: tuple[DirectionDocument, ...]


class FitDocument(DocumentPart):
    """One of the two fits, null where it does not define a number."""

    available: bool = True
    converged: bool
    reason: str
    iterations: int | None = None
    cost: Number = None
    rms_mm: Number = None
    rms_before_mm: Number = None
    rms_deg: Number = None
    rms_before_deg: Number = None
    chi2: Number
    dof: int | None
    p_value: Number
    noise_scale: Number
    other_basins: int = 0
    message: str | None = None


class FitsDocument(DocumentPart):
    """The likelihood fit and the paper's."""

    likelihood: FitDocument
    midpoint: FitDocument


class ToleranceDocument(DocumentPart):
    """Tolerances of the links."""

    length_mm: Tolerance
    angle_deg: Tolerance


class GeometryDocument(DocumentPart):
    """The geometry: tolerances, the model ladder, what the offsets are worth with nominal geometry."""

    tolerance: ToleranceDocument | None
    considered_tolerance: ToleranceDocument
    factors: Factors | None
    ladder: tuple[Rung, ...]
    consider: dict[str, Number]
    at_half: dict[str, Number]
    at_twice: dict[str, Number]
    confounded: tuple[Confounded, ...]


class PosteriorMessage(DocumentPart):
    """What is read back of the posterior."""

    converged: bool
    message: str | None


class PosteriorDocument(PosteriorMessage):
    """Diagnostics of the sampling; `parameters` is null unless it converged."""

    draws: int
    ensembles: int
    walkers: int
    ess_min: Number
    rhat_max: Number
    acceptance: Number
    seconds: float
    parameters: tuple[PosteriorParameter, ...] | None


class IntervalsDocument(DocumentPart):
    """The 95 % intervals of a parameter by three methods."""

    name: str
    unit: str
    linear: Interval
    profile: Interval | None
    posterior: Interval | None
    differ: bool


class AccuracyDocument(DocumentPart):
    """The accuracy at the TCP over the workspace."""

    point_mm: tuple[float, float, float]
    place: str
    workspace: Region | None
    near_shots: Region | None
    maps: tuple[Map, ...]
    undetermined: tuple[str, ...]
    weak: tuple[str, ...]
    sensitivity_mm2: Rows | None
    reason: str | None


class BudgetDocument(DocumentPart):
    """The uncertainty budget of a parameter."""

    name: str
    unit: str
    std: float
    rows: tuple[BudgetRow, ...]
    dof: Number
    coverage_factor: float
    expanded: float
    check: LinearCheck | None


class RobustParameterDocument(DocumentPart):
    """A parameter by the robust fit."""

    name: str
    unit: str
    estimate: Number
    std: Number
    interval95: Interval | None


class RobustDocument(DocumentPart):
    """The robust fit."""

    loss: Loss
    tuning: float
    converged: bool
    reason: str
    noise_scale: Number
    parameters: tuple[RobustParameterDocument, ...]
    weights: tuple[float, ...]
    outliers: tuple[int, ...]
    message: str | None


class HoldOutDocument(DocumentPart):
    """Placements held out."""

    targets: tuple[str, ...]
    placements: tuple[str, ...]
    shots: int
    shots_fitted: int
    rms_mm: Number
    rms_before_mm: Number
    expected_mm: Number
    chi2: Number
    dof: int | None
    p_value: Number
    message: str | None


class PredictedRunDocument(DocumentPart):
    """Another run as the fit predicts it."""

    run: str
    sha256: str
    targets: tuple[str, ...]
    targets_placed: tuple[str, ...]
    shots: int
    shots_fitted: int
    unknown: tuple[int, ...]
    taken_up: tuple[int, ...]
    rms_mm: Number
    median_mm: Number
    max_mm: Number
    rms_before_mm: Number
    median_before_mm: Number
    max_before_mm: Number
    expected_mm: Number
    u_mm: Number
    chi2: Number
    dof: int | None
    p_value: Number
    measurements: tuple[PredictedMeasurement, ...]
    message: str | None


class LeftOutDocument(DocumentPart):
    """A placement as the others predict it."""

    placement: str
    shots: int
    rms_mm: Number
    expected_mm: Number
    factor: Number
    chi2: Number
    dof: int | None
    p_value: Number
    message: str | None


class EffectiveDocument(DocumentPart):
    """The effective number of measurements."""

    recordings: tuple[RecordingCorrelation, ...]
    shots: int
    rho: Number
    kappa: Number
    p_value: Number
    divisor: float
    number: float


class PlacementsDocument(DocumentPart):
    """Placements left out in turn, the jackknife, correlation and steps of the recordings."""

    names: tuple[str, ...]
    leave_one_out: tuple[LeftOutDocument, ...]
    leave_one_out_rms_mm: Number
    leave_one_out_expected_mm: Number
    jackknife: dict[str, Number] | None
    jackknife_dof: int | None
    jackknife_needs: dict[str, tuple[str, ...]] | None
    effective: EffectiveDocument
    steps: tuple[RecordingStep, ...]
    steps_tested: int


class SentenceDocument(DocumentPart):
    """What is read back of a criterion or an explanation: its sentence."""

    sentence: str


class LackOfFitDocument(DocumentPart):
    """Residuals beyond the stated noise."""

    kind: Literal["chi2"]
    chi2: float
    dof: int
    p_value: float
    rms_mm: Number
    with_priors: bool
    geometry: Geometry
    factor: float
    sentence: str


class ImplausibleNoiseDocument(DocumentPart):
    """An estimated noise that is not plausible."""

    kind: Literal["noise_factor"]
    of: Literal["all", "joint", "spot"]
    factor: float
    interval: Interval
    plausible: float
    sentence: str


class BeyondPriorDocument(DocumentPart):
    """Estimates that contradict their priors."""

    kind: Literal["prior"]
    parameters: tuple[OffPrior, ...]
    limit: float
    sentence: str


class NominalContradictedDocument(DocumentPart):
    """Links that explain what nominal geometry leaves."""

    kind: Literal["nominal_geometry"]
    factor: float
    rank: int
    dof: int
    p_value: float
    before: float
    after: float
    sentence: str


class TightPriorDocument(DocumentPart):
    """Tolerances that are too small for their estimates."""

    kind: Literal["tight_prior"]
    of: str
    unit: str
    times: float
    stated: Number
    needed: Number
    largest: str
    estimate: float
    chi2: float
    dof: int
    p_value: float
    sentence: str


class PlacementsDisagreeDocument(DocumentPart):
    """Offsets that differ between placements."""

    kind: Literal["placements"]
    placements: tuple[str, ...]
    most: str
    factor: float
    rank: int
    dof: int
    p_value: float
    geometry: Geometry
    sentence: str


class MovedTargetDocument(DocumentPart):
    """A target that was displaced between two measurements."""

    kind: Literal["moved_target"]
    target: str
    after_shot: int
    before_shot: int
    p_value: float
    size_mm: Number
    size_std_mm: Number
    sentence: str


class StepDocument(DocumentPart):
    """Measurements of one recording that are off together."""

    kind: Literal["step"]
    target: str
    first_shot: int
    last_shot: int
    size_mm: Number
    p_value: float
    factor: float
    sentence: str


class ChangeDocument(DocumentPart):
    """A zero or a target that changed during the run."""

    kind: Literal["change"]
    how: How
    joint: int | None
    target: str | None
    after_shot: int
    before_shot: int
    amount: float
    std: float
    unit: str
    p_value: float
    sentence: str


CriterionDocument = Annotated[
    LackOfFitDocument
    | ImplausibleNoiseDocument
    | NominalContradictedDocument
    | BeyondPriorDocument
    | TightPriorDocument
    | PlacementsDisagreeDocument
    | MovedTargetDocument
    | StepDocument
    | ChangeDocument,
    Field(discriminator="kind"),
]


class MisfitDocument(DocumentPart):
    """Why the model does not describe the measurements."""

    criteria: tuple[CriterionDocument, ...]


class ExplanationDocument(DocumentPart):
    """What explains a misfit."""

    cause: Cause
    joints: tuple[int, ...]
    targets: tuple[str, ...]
    measurements: tuple[int, ...]
    factor: float
    agrees: bool
    odds: float
    sentence: str


class EnterDocument(DocumentPart):
    """Values to enter, and the error of the TCP to expect."""

    for_: TakenGeometry = Field(alias="for")
    values: dict[str, float]
    u: dict[str, float]
    tcp_before: TcpError | None
    tcp_after: TcpError | None
    worse: Number


class PowerDocument(DocumentPart):
    """The probability with which a run notices a wrong model."""

    wrong: WrongModel
    size: float
    unit: str
    joint: int | None
    probability: float
    off_u: float
    risk: float
    worst_size: Number
    dangerous: bool


class ResultDocument(DocumentPart):
    """The content of a result.json, in the order of its keys."""

    schema_: Literal["zerobeam/result/1"] = Field(alias="schema")
    verdict: Verdict
    message: Message
    coverage_factor: float
    headline: str
    parameters: tuple[ParameterDocument, ...]
    without_prior: WithoutPriorDocument | None
    identifiability: IdentifiabilityDocument
    fits: FitsDocument
    geometry: GeometryDocument
    posterior: PosteriorDocument
    shots: tuple[ShotResult, ...]
    distances: tuple[DistanceResult, ...]
    angles: tuple[AngleResult, ...]
    intervals: tuple[IntervalsDocument, ...]
    accuracy: AccuracyDocument
    budget: tuple[BudgetDocument, ...]
    robust: RobustDocument | None
    hold_out: HoldOutDocument | PredictedRunDocument | None
    placements: PlacementsDocument
    scene: RunScene | None
    misfit: MisfitDocument | None
    diagnosis: tuple[ExplanationDocument, ...]
    enter: EnterDocument | None
    enter_geometry: EnterDocument | None
    conformity: Conformity | None
    power: tuple[PowerDocument, ...]
    notes: tuple[str, ...]
    next_steps: NextSteps
    inputs: Inputs


class CheckedParameterDocument(DocumentPart):
    """A row of the `parameters` of a check."""

    name: str
    unit: str
    group: str
    status: Status
    held: bool
    data_std: Number
    std: Number
    prior_std: float
    tolerance_share: Number
    reason: str | None


class CheckDocument(DocumentPart):
    """What `zerobeam check --json` prints, in the order of its keys."""

    schema_: Literal["zerobeam/check/1"] = Field(alias="schema")
    verdict: PlanVerdict
    headline: str
    parameters: tuple[CheckedParameterDocument, ...]
    identifiability: IdentifiabilityDocument
    power: tuple[PowerDocument, ...]
    geometry: GeometryDocument
    postures: tuple[CheckedPosture, ...]
    curve: tuple[CurvePoint, ...]
    over_target: OverTarget | None
    advice: Advice | None
    notes: tuple[str, ...]
    inputs: PlanInputs


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
