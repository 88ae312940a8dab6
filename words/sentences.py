"""What words say of answers: the sentences of `result.json` and of what `check --json` prints.

What the data do not determine leaves here as null, or not at all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ..analysis.answer.result import LikelihoodSummary, Result
from ..analysis.diagnostics.accuracy import TcpAccuracy
from ..analysis.diagnostics.diagnosis import Explanation
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.diagnostics.outliers import Robust
from ..analysis.left_over import Contradiction
from ..analysis.observability.causes import JudgedRow, NullDirection
from ..analysis.observability.check import Check
from ..analysis.pendant_check.pose_check import PendantCheck
from ..analysis.posterior.posterior import PosteriorSummary
from ..analysis.prediction import PredictedRun
from ..analysis.repeatability.compare import ComparedRun, Comparison
from ..analysis.solution import ParameterTable
from ..analysis.tcp_region import TcpRegion
from ..model import records
from . import comparison
from .finding_words import (
    accuracy_reason,
    hold_out_message,
    likelihood_message,
    notes,
    posterior_message,
    predicted_run_message,
    robust_message,
    tcp_words,
)
from .message import headline, message, next_steps, offered
from .misfit_words import criterion_sentence, explanation_sentence
from .observability import direction_remedy, reason, reason_of
from .outlook_words import region_words
from .pendant_check import check_sentences
from .plan_catalogue import check_notes
from .trust import tolerances_of, trusted


def _failure(run: ComparedRun) -> str | None:
    return None if run.reason is None else comparison.failure(run.reason)


# By the class of a record: what is said of it under each of its worded keys.
WORDS: dict[type, dict[str, Callable[[Any], object]]] = {
    JudgedRow: {"reason": reason_of},
    NullDirection: {"reason": lambda one: reason(one.cause), "remedy": direction_remedy},
    LikelihoodSummary: {"message": likelihood_message},
    PosteriorSummary: {"message": posterior_message},
    TcpAccuracy: {"place": tcp_words, "reason": accuracy_reason},
    TcpRegion: {"name": region_words},
    Robust: {"message": robust_message},
    HoldOut: {"message": hold_out_message},
    PredictedRun: {"message": predicted_run_message},
    Explanation: {"sentence": explanation_sentence},
    Comparison: {"headline": comparison.headline, "notes": lambda runs: tuple(comparison.notes(runs))},
    ComparedRun: {"failure": _failure},
    PendantCheck: {"sentences": check_sentences},
    Check: {"headline": headline, "notes": check_notes},
    Contradiction: {"sentence": criterion_sentence},
}


def to_json(answer: object) -> Any:
    """An answer as plain values of JSON, with its sentences; `Result` and whatever is a part of one.

    Raises UnsoundResult if a number is not finite.
    """
    return records.to_json(in_words(answer) if isinstance(answer, Result) else answer, WORDS)


def in_words(result: Result) -> Result:
    """The result with what it says first, what may be entered, and what to do."""
    first = message(result)
    entered = offered(result, first)
    k, tolerances = result.coverage_factor, tolerances_of(result.inputs.header)
    rows = (
        replace(row, trusted=trusted(row, k, tolerances)) if row.group == "offset" else row
        for row in result.parameters
    )
    return replace(
        result,
        parameters=ParameterTable(rows),
        message=first,
        headline=headline(result),
        enter=entered,
        enter_geometry=result.entered_geometry if entered else None,
        conformity=result.conformity if entered else None,
        notes=notes(result),
        next_steps=next_steps(result, first),
    )
