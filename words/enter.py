"""Sentences about the values to enter, the error of the TCP that they leave, and what the robot must meet."""

from __future__ import annotations

from ..analysis.answer.result import Result
from ..analysis.diagnostics.values_to_enter import Conformity, TcpError
from . import numbers
from .controllers import taken_by

WHY_THEY_DIFFER = (
    "The values are not the offsets of the arm: the controller computes with nominal links, so the values"
    " also make up for links that deviate and joints that bend, as far as offsets can. The U of a value"
    " includes how well these are known: it may be larger than that of the offset."
)
NOT_CLAIMED = "What they gain at the TCP is not claimed: it depends on what is not determined."
NO_REQUIREMENT = (
    "The header states no requirement (required: {tcp_mm: …}): the report says what was determined, not"
    " whether the robot is accurate enough."
)
_DECISIONS = {
    "conforms": "the robot conforms",
    "does not conform": "the robot does not conform",
    "undecided": "the measurements do not decide it",
}


def enter_sentence(result: Result) -> str | None:
    """What entering the values gains at the TCP, or the model where no values can be entered; None where
    there are none."""
    if taken_by(result.inputs.vendor) != "offsets":
        return model_sentence(result)
    entered = result.entered
    if entered is None:
        return None
    if entered.tcp_before is None or entered.tcp_after is None:
        return NOT_CLAIMED
    before, after = entered.tcp_before, entered.tcp_after
    doubt = (
        f" With a probability of {100 * (entered.worse or 0.0):.0f} % the robot is less accurate with the"
        " values than without: enter the values only if a verification shows that they help."
        if entered.doubtful
        else ""
    )
    return (
        f"With the values entered the TCP is off by {_mm(after.median_mm)} instead of"
        f" {_mm(before.median_mm)} (median of the workspace), and by less than {_mm(after.p95_mm)} instead of"
        f" {_mm(before.p95_mm)} in 95 % of it.{doubt}"
    )


def geometry_sentence(result: Result) -> str | None:
    """What a controller or program gains that takes links too; None where there is nothing to say."""
    entered, whole = result.entered, result.entered_geometry
    if entered is None or whole is None or entered.tcp_after is None or whole.tcp_after is None:
        return None
    (before, _), (median, p95) = error_words(entered.tcp_after), error_words(whole.tcp_after)
    if median == before:
        return None
    return f"Where links can be entered too (export robot, export urdf), {median} and {p95} are left."


def model_sentence(result: Result) -> str | None:
    """What the corrected model or program gains at the TCP; None where that is not known."""
    taken = result.entered_geometry or result.entered
    if taken is None or taken.tcp_before is None or taken.tcp_after is None:
        return None
    (before, most), (after, least) = error_words(taken.tcp_before), error_words(taken.tcp_after)
    return (
        f"By the corrected model or program the TCP is off by {after} instead of {before} (median of the"
        f" workspace), and by less than {least} instead of {most} in 95 % of it."
    )


def conformity_sentence(result: Result) -> str:
    """Whether the robot meets what it must; that nothing is required, where nothing is stated."""
    if result.conformity is not None:
        takes = taken_by(result.inputs.vendor) == "offsets"
        return _decided(result.conformity, "With the values entered" if takes else "By its offsets alone")
    required = result.inputs.header.get("required")
    if not isinstance(required, dict):
        return NO_REQUIREMENT
    return (
        f"Required: 95 % of the workspace within {numbers.exact(float(required['tcp_mm']), 'mm')} at the TCP."
        " Whether the robot meets that cannot be said: the TCP is not determined."
    )


_MET = {
    "conforms": "the required {} at the TCP is met",
    "does not conform": "the required {} at the TCP is not met",
    "undecided": "whether the required {} at the TCP is met is not decided",
}


def met_words(conformity: Conformity) -> str:
    """Whether the robot meets what it must, in a few words."""
    return _MET[conformity.decision].format(numbers.exact(conformity.required_mm, "mm"))


def expected_sentence(conformity: Conformity, after: TcpError) -> str:
    """Why it does or does not: `after` is the error with the values entered."""
    return (
        f"With the values entered the TCP is off by less than {_mm(after.p95_mm)} in 95 % of the workspace;"
        f" the requirement is met with {_probability(conformity.probability)}."
    )


def _decided(conformity: Conformity, corrected: str) -> str:
    return (
        f"Required: 95 % of the workspace within {numbers.exact(conformity.required_mm, 'mm')} at the TCP."
        f" {corrected} the requirement is met with {_probability(conformity.probability)}. So"
        f" {_DECISIONS[conformity.decision]} (JCGM 106: from 95 % on it conforms, up to 5 % it does not)."
    )


def _probability(p: float) -> str:
    if p in (0.0, 1.0):
        return f"a probability {'below 1' if p == 0 else 'above 99'} %"
    return f"a probability of {100 * p:.0f} %"


def error_words(error: TcpError) -> tuple[str, str]:
    """Median, and what 95 % stay below, each with its unit."""
    return _mm(error.median_mm), _mm(error.p95_mm)


def _mm(value: float) -> str:
    return numbers.significant(value, 2, "mm")
