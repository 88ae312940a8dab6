"""Sentences about the values to enter, the error of the TCP that they leave, what the robot must meet, and
the acceptance test of a corrected robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ..analysis.acceptance import (
    AIM,
    FALSE_ALARM,
    POWER,
    Acceptance,
    AcceptanceResult,
    EnteredOffset,
    LackingTest,
    MeasuredError,
    Mistake,
    MistakeKind,
)
from ..analysis.diagnostics.values_to_enter import Conformity, TcpError
from ..analysis.status import NOT_DESCRIBED
from ..analysis.tcp_region import TcpRegion
from . import numbers
from .controllers import links_command, taken_by
from .numbers import percent
from .outlook_words import region_first, region_words
from .run_argument import run_argument
from .wording import counted, joints, label, listed

if TYPE_CHECKING:
    from ..analysis.answer.result import Result

WHY_THEY_DIFFER = (
    "The values are not the offsets of the arm: the controller computes with nominal links, so the values"
    " also make up for links that deviate and joints that deflect, as far as offsets can. The U of a value"
    " includes how well these are known: it may be larger than that of the offset."
)
U_OF_VALUES = "Values make up for links too: each U is the value's."
# They are fitted together.
ALL_OR_NONE = "Add all or none to the readings; they make up for links too: U is their own."
NOT_CLAIMED = "Their gain at the TCP is not claimed: it depends on an undetermined offset."
TCP_NOT_CLAIMED = "TCP error: not claimed, since it depends on an undetermined offset."
TCP_OF_A_MISFIT = f"TCP error: not claimed, since {NOT_DESCRIBED}."
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
        f"{region_first(result.region)} the TCP is off by {_mm(after.median_mm)} instead of"
        f" {_mm(before.median_mm)} (median) with the values entered, and by less than {_mm(after.p95_mm)}"
        f" instead of {_mm(before.p95_mm)} in 95 % of the postures.{doubt}"
    )


def floor_sentence(result: Result) -> str | None:
    """What offsets alone leave however well they are known; None where there is nothing to say."""
    entered = result.entered
    if entered is None or entered.tcp_best is None or entered.tcp_after is None:
        return None
    (after, _), (best, _) = error_words(entered.tcp_after), error_words(entered.tcp_best)
    alone = f"Offsets alone leave {best} (median, {region_words(result.region)})"
    if after == best:
        return f"{alone}: better measurements do not lower it, since the links deviate."
    return f"{alone} even if they are known exactly, since the links deviate: {after} is reached."


def links_step(result: Result, *, enter: bool = True) -> tuple[str, str] | None:
    """What a controller or program gains that takes links too, and the command that writes them; None where
    there is nothing to say. Without `enter`, what is gained is said alone."""
    entered, whole = result.entered, result.entered_geometry
    if entered is None or whole is None or entered.tcp_after is None or whole.tcp_after is None:
        return None
    (before, _), (median, p95) = error_words(entered.tcp_after), error_words(whole.tcp_after)
    if median == before or whole.tcp_after.median_mm > entered.tcp_after.median_mm:
        return None
    command, file = links_command(result.inputs.vendor, result.inputs.header.get("robot"))
    text = (
        f"{floor_sentence(result) or ''} Where the links can be entered too (ROS, RoboDK, a controller with"
        f" absolute accuracy), {median} is left, and less than {p95} in 95 % of the postures"
        f"{': enter these instead of the values above' if enter else ''}."
    )
    return text.strip(), f"zerobeam {command} {run_argument(result.inputs.run)} -o {file}"


def model_sentence(result: Result) -> str | None:
    """What the corrected model or program gains at the TCP; None where that is not known."""
    taken = result.entered_geometry or result.entered
    if taken is None or taken.tcp_before is None or taken.tcp_after is None:
        return None
    (before, most), (after, least) = error_words(taken.tcp_before), error_words(taken.tcp_after)
    return (
        f"{region_first(result.region)} the TCP is off by {after} instead of {before} (median) by the"
        f" corrected model or program, and by less than {least} instead of {most} in 95 % of the postures."
    )


def conformity_sentence(result: Result) -> str:
    """Whether the robot meets what it must; that nothing is required, where nothing is stated."""
    if result.conformity is not None:
        takes = taken_by(result.inputs.vendor) == "offsets"
        corrected = "With the values entered" if takes else "By its offsets alone"
        return _decided(result.conformity, corrected, result.region)
    required = result.inputs.header.get("required")
    if not isinstance(required, dict):
        return NO_REQUIREMENT
    axis = None if result.region is None else result.region.on_axis
    why = "is not determined" if axis is None else f"rotates with J{axis}, which is not determined"
    return (
        f"Required at the TCP: {required_words(required)} in 95 % of the postures. Whether the robot meets"
        f" that cannot be said: the TCP {why}."
    )


def required_words(required: Mapping[str, object]) -> str:
    """What a header's `required` states of the TCP."""
    return numbers.exact(float(str(required["tcp_mm"])), "mm")


_MET = {
    "conforms": "meets the required {}",
    "does not conform": "does not meet the required {}",
    "undecided": "whether it meets the required {} is not decided",
}


def met_words(conformity: Conformity) -> str:
    """Whether the robot meets what it must, in a few words."""
    return _MET[conformity.decision].format(numbers.exact(conformity.required_mm, "mm"))


def expected_sentence(conformity: Conformity, after: TcpError, region: TcpRegion | None) -> str:
    """Why it does or does not: `after` is the error with the values entered."""
    return (
        f"With the values entered the TCP is off by less than {_mm(after.p95_mm)} in 95 % of the postures"
        f" {region_words(region)}; the requirement is met with {_probability(conformity.probability)}."
    )


def beyond_offsets_sentence(result: Result) -> str | None:
    """That no offsets meet the requirement, or hardly any may; None where the best of them do."""
    entered, conformity = result.entered, result.conformity
    if entered is None or entered.tcp_best is None or conformity is None:
        return None
    best = entered.tcp_best
    if best.p95_mm <= conformity.required_mm:
        return None
    sure = best.median_band_mm[0] > conformity.required_mm
    return (
        f"Offsets alone {'cannot' if sure else 'may not'} meet it: known exactly they leave up to"
        f" {_mm(best.p95_mm)} in 95 % of the postures, since the links deviate."
    )


def _required(tcp_mm: float, region: TcpRegion | None) -> str:
    within = numbers.exact(tcp_mm, "mm")
    return f"Required at the TCP: {within} in 95 % of the postures {region_words(region)}."


def _decided(conformity: Conformity, corrected: str, region: TcpRegion | None) -> str:
    return (
        f"{_required(conformity.required_mm, region)} {corrected} the requirement is met with"
        f" {_probability(conformity.probability)}. So {_DECISIONS[conformity.decision]} (JCGM 106: from 95 %"
        " on it conforms, up to 5 % it does not)."
    )


def _probability(p: float) -> str:
    if not 0.01 <= p <= 0.99:
        return f"a probability {'below 1' if p < 0.01 else 'above 99'} %"
    return f"a probability of {100 * p:.0f} %"


def error_words(error: TcpError) -> tuple[str, str]:
    """Median, and what 95 % stay below, each with its unit."""
    return _mm(error.median_mm), _mm(error.p95_mm)


def _mm(value: float) -> str:
    return numbers.significant(value, 2, "mm")


ACCEPTANCE_WORDS: dict[Acceptance, str] = {"pass": "Pass", "fail": "Fail", "inconclusive": "Inconclusive"}
RULE = (
    f"Fail where residuals as large have a probability below {percent(FALSE_ALARM)} for a robot that is as"
    " its calibration says (the probability of a false alarm). Pass where they agree, and an error of the"
    " tolerance in any one offset would have been noticed with a probability of at least"
    f" {percent(POWER)}. Else inconclusive."
)
CONTROLLERS_MODEL = (
    "Each error is the residual of a measurement by the controller’s model: nominal geometry, joints as the"
    " controller reads them. Targets, and instruments without one, are where the measurements of that time"
    " fit best, so that their places may have changed. The error as left holds what the calibration predicts"
    " of links that deviate: the test judges the residuals beyond that. It is an error at the target, not at"
    " the TCP."
)
_ENTERED: dict[MistakeKind, str] = {
    "not entered": "left at the old value",
    "wrong sign": "entered with the wrong sign",
    "entered twice": "corrected twice (entered twice, or programs corrected too)",
    "joint 2 added": "entered with the value of J2 (δ2) added",
    "joint 2 subtracted": "entered with the value of J2 (δ2) subtracted",
}


def acceptance_reason(answer: AcceptanceResult) -> str:
    """Why the verdict is what it is, in a sentence."""
    rms = f"{numbers.significant(answer.rms_mm, 2, 'mm')} rms"
    expected = numbers.significant(answer.expected_mm, 2, "mm")
    if answer.p_value is None or answer.statistic is None:
        count = counted(answer.measurements, "measurement")
        return f"{count} leave no degree of freedom: record more postures."
    chi2 = numbers.significant(answer.statistic * answer.dof)
    measure = f"χ² {chi2}, {answer.dof} dof, {numbers.p_words(answer.p_value)}"
    if answer.verdict == "fail":
        return (
            f"The corrected robot is not where its calibration says: residuals {rms}, where {expected} were"
            f" predicted ({measure}). Do not use it; a false alarm has a probability of"
            f" {percent(FALSE_ALARM)}. Put the old values back, look for the mistake in what was entered, and"
            " test again."
        )
    agrees = f"Residuals {rms} agree with the prediction ({measure})"
    if answer.verdict == "pass":
        tested = listed(joints([offset.name for offset in answer.offsets]))
        return (
            f"{agrees}, and an error of the tolerance in {tested} would have been noticed with a probability"
            f" of at least {percent(POWER)}. No other joint is tested."
        )
    names = listed([label(offset.name) for offset in answer.unnoticed])
    return (
        f"{agrees}, but an error of the tolerance in {names} might have gone unnoticed: record all postures"
        " of the plan, or more of them (zerobeam plan verify with a larger --shots)."
    )


_TOO_FEW = (
    ": here it cannot pass. Record more postures of the run (--shots N); where all of them are in the plan,"
    " calibrate again with more measurements (zerobeam plan optimal --shots N)."
)


def noticed_sentence(offsets: Sequence[EnteredOffset]) -> str:
    """What the probabilities of the table are, and what a pass needs."""
    lacking = any(offset.power < POWER for offset in offsets)
    return (
        "Probability of noticing an error. A correct calibration fails with a probability of"
        f" {percent(FALSE_ALARM)}. To pass, the test needs {percent(POWER)} against an error of the tolerance"
        " in each offset"
        f"{'.' if not lacking else _TOO_FEW}"
    )


def narrow_sentence() -> str:
    """Of a planned test whose power is enough, and less than a plan aims at."""
    return (
        f"A plan aims at {percent(AIM)}, so that a run that differs a little from it still passes. The"
        " postures of this run do not reach that: record all of them with care, or calibrate with more"
        " measurements (zerobeam plan optimal --shots N)."
    )


def lacking_test_sentence(lacking: LackingTest) -> str:
    """A plan whose calibration leaves no acceptance test, and with how many measurements it would."""
    limit = numbers.exact(lacking.tolerance, numbers.unit_of(lacking.unit))
    text = (
        f"A calibration by {counted(lacking.measurements, 'measurement')} is predicted to leave no acceptance"
        f" test that can pass: it would notice that {label(lacking.name)} is off by the tolerance of {limit}"
        f" with a probability of {probability_words(lacking.power)}, and needs {percent(POWER)}."
    )
    if lacking.needed is None:
        return f"{text} No number of such measurements is enough: lower the noise, or widen the tolerance."
    return f"{text} Some {lacking.needed} measurements of this kind would be enough (--shots)."


def mistake_sentence(mistake: Mistake) -> str:
    """A mistake in entering that would explain the measurements."""
    names = listed([label(name) for name in mistake.offsets])
    return (
        f"The measurements agree with {names} {_ENTERED[mistake.kind]} ({numbers.p_words(mistake.p_value)})."
    )


def probability_words(share: float) -> str:
    """Rounded down: what is less than enough never looks like enough."""
    return "over 99 %" if share > 0.99 else f"{int(100 * share)} %"


def measured_sentence(measured: MeasuredError) -> str:
    """The error before and after, and the noise that no calibration takes away."""
    after, noise = measured.after, numbers.significant(measured.noise_mm, 2, "mm")
    of_noise = f"the noise of one measurement is {noise}"
    left = f"{numbers.significant(after.rms_mm, 2, 'mm')} rms ({_worst(after.worst_mm)})"
    if measured.before is None:
        return (
            f"Measured error: {left} as left; {of_noise}. As found is not known: the"
            " calibration has no measurement at some of these postures."
        )
    before = (
        f"{numbers.significant(measured.before.rms_mm, 2, 'mm')} rms ({_worst(measured.before.worst_mm)})"
    )
    return f"Measured error: {before} as found, {left} as left; {of_noise}."


def not_judged_sentence(conformity: Conformity) -> str:
    """Whether the robot meets what is required of it, which this test does not say."""
    return f"This test does not judge the error of the TCP; the calibration does: {met_words(conformity)}."


def _worst(worst_mm: float) -> str:
    return f"worst {numbers.significant(worst_mm, 2, 'mm')}"
