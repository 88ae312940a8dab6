"""`result.json` and what `check --json` prints: documents filled from answers, with the sentences of `words`.

What the data do not determine leaves here as null, or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

from ..analysis.answer import document, document_part, misfit_document
from ..analysis.answer.result import RESULT_SCHEMA, Result
from ..analysis.diagnostics.hold_out import HoldOut, PlacementResult
from ..analysis.diagnostics.predicted_run import PredictedRun
from ..analysis.displacement import Displacement
from ..analysis.misfit import (
    BeyondPrior,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    NominalContradicted,
    PlacementsDisagree,
)
from ..analysis.observability.basis import Basis
from ..analysis.observability.causes import NullDirection
from ..analysis.observability.changes import RunChange
from ..analysis.observability.check import Check
from ..analysis.observability.geometry import GeometryResult
from ..analysis.observability.identifiability import Identifiability
from ..analysis.observability.power import DetectionPower
from ..analysis.recordings.steps import RecordingStep
from ..analysis.solution import ParameterResult
from ..analysis.tight_priors import TightPrior
from .findings import (
    accuracy_reason,
    hold_out_message,
    likelihood_message,
    notes,
    posterior_message,
    predicted_run_message,
    robust_message,
    tcp_words,
)
from .message import headline, message
from .misfit import criterion_sentence, explanation_sentence
from .next_steps import next_steps, offered
from .observability import direction_remedy, reason
from .verdict import check_headline, check_notes

CHECK_SCHEMA = "zerobeam/check/1"
_CRITERIA: dict[type, type[document_part.DocumentPart]] = {
    LackOfFit: misfit_document.LackOfFitDocument,
    ImplausibleNoise: misfit_document.ImplausibleNoiseDocument,
    NominalContradicted: misfit_document.NominalContradictedDocument,
    BeyondPrior: misfit_document.BeyondPriorDocument,
    TightPrior: misfit_document.TightPriorDocument,
    PlacementsDisagree: misfit_document.PlacementsDisagreeDocument,
    Displacement: misfit_document.MovedTargetDocument,
    RecordingStep: misfit_document.StepDocument,
    RunChange: misfit_document.ChangeDocument,
}


def to_json(result: Result) -> dict[str, Any]:
    """The result as dicts, lists, strings, bools, ints and finite floats, keys in the document's order.

    Raises UnsoundResult if a number is not finite.
    """
    return document_of(result).to_json()


def document_of(result: Result) -> document.ResultDocument:
    """The result with its sentences."""
    alone, robust, held_out = result.without_prior, result.robust, result.hold_out
    verdict_message, entered = message(result), offered(result)
    steps = next_steps(result, verdict_message)
    with_links = result.entered_geometry if entered else None
    return document.ResultDocument.filled(
        result,
        schema_=RESULT_SCHEMA,
        message=verdict_message,
        headline=headline(result),
        parameters=tuple(map(parameter_document, result.parameters)),
        without_prior=alone and document.WithoutPriorDocument.filled(alone),
        identifiability=_identifiability(result.identifiability),
        fits=_fits(result),
        geometry=geometry_document(result.geometry),
        posterior=document.PosteriorDocument.filled(
            result.posterior, message=posterior_message(result.posterior)
        ),
        intervals=tuple(document.IntervalsDocument.filled(row) for row in result.intervals),
        accuracy=document.AccuracyDocument.filled(
            result.accuracy, place=tcp_words(result.accuracy), reason=accuracy_reason(result.accuracy)
        ),
        budget=tuple(document.BudgetDocument.filled(row) for row in result.budget),
        robust=robust
        and document.RobustDocument.filled(
            robust,
            parameters=tuple(document.RobustParameterDocument.filled(row) for row in robust.parameters),
            message=robust_message(robust),
        ),
        hold_out=held_out and _hold_out(held_out),
        placements=_placements(result.placements),
        misfit=_misfit(result.misfit),
        diagnosis=tuple(
            document.ExplanationDocument.filled(one, sentence=explanation_sentence(one))
            for one in result.diagnosis
        ),
        enter=entered and document.EnterDocument.filled(entered, for_=entered.of),
        enter_geometry=with_links and document.EnterDocument.filled(with_links, for_=with_links.of),
        taken_as_known=tuple(map(_basis, result.taken_as_known)),
        notes=notes(result),
        conformity=entered and result.conformity,
        power=_powers(result.power),
        next_steps=steps,
    )


def _basis(basis: Basis) -> document.BasisDocument:
    sizes = tuple(document.SizeDocument.filled(size) for size in basis.sizes)
    return document.BasisDocument.filled(basis, sizes=sizes)


def _hold_out(
    held_out: HoldOut | PredictedRun,
) -> document.HoldOutDocument | document.PredictedRunDocument:
    if isinstance(held_out, PredictedRun):
        return document.PredictedRunDocument.filled(held_out, message=predicted_run_message(held_out))
    return document.HoldOutDocument.filled(held_out, message=hold_out_message(held_out))


def check_json(check: Check) -> dict[str, Any]:
    """The answer of a check, null where there is no number."""
    answer = document.CheckDocument.filled(
        check,
        schema_=CHECK_SCHEMA,
        headline=check_headline(check),
        parameters=tuple(
            document.CheckedParameterDocument.filled(row, reason=row.cause and reason(row.cause))
            for row in check.parameters
        ),
        identifiability=_identifiability(check.identifiability),
        power=_powers(check.power),
        geometry=geometry_document(check.geometry),
        notes=check_notes(check),
    )
    return answer.to_json()


def power_json(powers: Sequence[DetectionPower]) -> list[dict[str, Any]]:
    """The power against each wrong model."""
    return [row.to_json() for row in _powers(powers)]


def _powers(powers: Sequence[DetectionPower]) -> tuple[document.PowerDocument, ...]:
    return tuple(map(document.PowerDocument.filled, powers))


def dumps(answer: dict[str, Any]) -> str:
    """The text of `result.json`: keys in their given order, floats to the last digit, UTF-8 safe."""
    # One line for each item of the second level: C writes them, and with an indent Python would.
    text = _item_by_item(answer, "", lambda value: _item_by_item(value, " ", _LINE.encode))
    return _encodable(text) + "\n"


def one_line(value: object) -> str:
    """The same of a part, on one line."""
    return _encodable(_LINE.encode(value))


def _encodable(text: str) -> str:
    """A lone surrogate cannot be encoded in UTF-8, but its escape is legal JSON and says the same."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


_LINE = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def _item_by_item(value: object, margin: str, write: Callable[[Any], str]) -> str:
    """A dict or list with a line for each item behind `margin`, as `write` writes them."""
    if not value or not isinstance(value, dict | list | tuple):
        return _LINE.encode(value)
    if isinstance(value, dict):
        ends, rows = "{}", [f"{_LINE.encode(key)}: {write(item)}" for key, item in value.items()]
    else:
        ends, rows = "[]", [write(item) for item in value]
    inner = f"\n{margin} "
    return f"{ends[0]}{inner}{f',{inner}'.join(rows)}\n{margin}{ends[1]}"


def parameter_document(row: ParameterResult) -> document.ParameterDocument:
    """A row of `parameters`."""
    result = document.ParameterDocument.filled(row, reason=row.cause and reason(row.cause))
    if row.group != "offset":
        result.model_fields_set.discard("tolerance_share")
    return result


def geometry_document(geometry: GeometryResult) -> document.GeometryDocument:
    """What an answer says of the geometry."""
    tolerance = document.ToleranceDocument.filled(geometry)
    return document.GeometryDocument.filled(
        geometry, tolerance=tolerance if geometry.stated else None, considered_tolerance=tolerance
    )


def _identifiability(facts: Identifiability) -> document.IdentifiabilityDocument:
    return document.IdentifiabilityDocument.filled(
        facts, null_space=tuple(direction_document(one) for one in facts.null_space)
    )


def direction_document(direction: NullDirection) -> document.DirectionDocument:
    """A null-space direction in words."""
    cause = direction.cause
    return document.DirectionDocument.filled(
        direction, reason=reason(cause), remedy=direction_remedy(direction)
    )


def _fits(result: Result) -> document.FitsDocument:
    likelihood, none = (
        result.likelihood,
        dict.fromkeys(
            ("rms_before_mm", "rms_deg", "rms_before_deg", "chi2", "dof", "p_value", "noise_scale")
        ),
    )
    return document.FitsDocument.model_construct(
        likelihood=document.FitDocument.filled(
            likelihood, available=True, message=likelihood_message(likelihood)
        ),
        midpoint=document.FitDocument.filled(result.midpoint, **none, other_basins=0),
    )


def _misfit(misfit: Misfit | None) -> misfit_document.MisfitDocument | None:
    if misfit is None:
        return None
    rows = []
    for one in misfit.criteria:
        at = one.at._asdict() if isinstance(one, Displacement | RunChange) else {}
        rows.append(_CRITERIA[type(one)].filled(one, sentence=criterion_sentence(one), **at))
    return misfit_document.MisfitDocument.model_construct(criteria=tuple(rows))


def _placements(result: PlacementResult) -> document.PlacementsDocument:
    left_out, jackknife = result.leave_one_out, result.jackknife
    return document.PlacementsDocument.filled(
        result,
        leave_one_out=tuple(
            document.LeftOutDocument.filled(
                row, placement=", ".join(row.placements), message=hold_out_message(row)
            )
            for row in (() if left_out is None else left_out.rows)
        ),
        leave_one_out_rms_mm=left_out and left_out.rms_mm,
        leave_one_out_expected_mm=left_out and left_out.expected_mm,
        jackknife=jackknife and {row.name: row.u for row in jackknife.offsets},
        jackknife_dof=jackknife and jackknife.dof,
        jackknife_needs=jackknife and {row.name: row.needs for row in jackknife.offsets if row.needs},
        effective=document.EffectiveDocument.filled(result.effective),
        steps=result.steps.rows,
        steps_tested=result.steps.tested,
    )
