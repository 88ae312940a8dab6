"""The acceptance test of a corrected robot in words: verdict, rule, what was measured before and after."""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.acceptance.acceptance import (
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
from ..analysis.diagnostics.values_to_enter import Conformity
from . import numbers
from .enter import met_words
from .numbers import percent
from .wording import counted, label, listed

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
        return (
            f"{agrees}, and an error of the tolerance in any offset would have been noticed with a"
            f" probability of at least {percent(POWER)}."
        )
    names = listed([label(offset.name) for offset in answer.unnoticed])
    return (
        f"{agrees}, but an error of the tolerance in {names} might have gone unnoticed: record more postures"
        " (zerobeam plan verify RUN -o PLAN --shots N)."
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
