"""What an answer is worth: its grade, and what may be done with it. One rule for all who colour a verdict,
list it, sign it, or write its values: report, terminal, app, history, certificate, exporters.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from ..analysis.answer.answer_message import Grade, May
from ..analysis.answer.findings import Finding, HeldOutMisfit, OtherBasins, Outlying
from ..analysis.answer.result import Result
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.misfit import ExactDoubted
from ..analysis.status import Verdict, known
from .controllers import lacks_factory_calibration, taken_by
from .provenance import is_simulated

_AGAINST = (OtherBasins, ExactDoubted, HeldOutMisfit, Outlying, HoldOut)
# Of results without a grade (before it was stated): their action says that nothing is to be entered, and not
# because no robot was measured, none of its offsets is estimated, or its controller takes none.
_ENTER_NOTHING = re.compile(
    r"Check |Enter nothing(?!: (?:no (?:robot|offset|published)|how this controller))"
)


@dataclass(frozen=True)
class Judgement:
    """`against`: something speaks against values although the verdict may be a pass: other optima, an arm
    that is hardly exact, a held-out run or target that is not predicted, outliers, a placement that the
    others do not predict."""

    grade: Grade
    may: May
    against: bool


def against(findings: Iterable[Finding | HoldOut]) -> Finding | HoldOut | None:
    """What speaks against an answer whose verdict is a pass; the gravest first, None where nothing does."""
    return next((one for one in findings if isinstance(one, _AGAINST)), None)


def judgement(
    verdict: Verdict,
    *,
    contradicted: bool,
    converged: bool,
    determined: bool,
    simulated: bool,
    unmet: bool,
    vendor: str | None,
    robot: object,
) -> Judgement:
    """`contradicted`: something is `against` it; `determined`: the data determine an offset; `unmet`: the
    robot does not surely meet what it must; `robot` is that of the header."""
    sound = converged and verdict != "misfit" and not contradicted and determined
    grade: Grade = verdict
    if verdict == "pass":
        if contradicted:
            grade = "weak"
        elif simulated or not determined:
            grade = "held"
        elif unmet:
            grade = "weak"
    takes = taken_by(vendor) == "offsets" and not lacks_factory_calibration(vendor, robot)
    enter = sound and verdict == "pass" and not simulated and takes
    return Judgement(grade, May(enter=enter, certify=sound, export=sound), contradicted)


def read_judgement(result: Result) -> Judgement:
    """Of a result.json: as it states it; of an earlier version by what its message says to do."""
    message = result.message
    contradicted = message is not None and _ENTER_NOTHING.match(message.action.text) is not None
    if message is not None and message.grade is not None:
        return Judgement(message.grade, message.may, contradicted)
    return judgement(
        result.verdict,
        contradicted=contradicted,
        converged=result.fits.likelihood.converged,
        determined=any(known(row.status) for row in result.offsets),
        simulated=is_simulated(result.inputs.provenance),
        unmet=result.conformity is not None and result.conformity.decision != "conforms",
        vendor=result.inputs.vendor,
        robot=result.inputs.header.get("robot"),
    )


def verdict_words(verdict: Verdict, judged: Judgement | None) -> str:
    """The verdict as lists say it: of a pass by which nothing is to be entered with that; `judged` is None
    where the result cannot be read."""
    if verdict != "pass":
        return verdict
    if judged is None:
        return "pass, result unreadable"
    return "pass, enter nothing" if judged.against else verdict
