"""The criteria of a misfit in `result.json`, by their `kind` (docs/files-results.md)."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ..misfit import Geometry, OffPrior
from ..observability.changes import How
from .document_part import DocumentPart, Interval, Number


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
