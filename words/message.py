"""The one message of an answer: verdict, least well determined offset, cause, action, cautions.

Terminal, HTML, PDF, JSON, Python and app show it first, as it is. A misfit names its cause before all else,
and nothing that follows from the wrong model stands beside it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from ..analysis.answer.answer_message import Action, Message, WorstOffset
from ..analysis.answer.findings import (
    FileWarning,
    Finding,
    HeldOutMisfit,
    NotConverged,
    OtherBasins,
    Outlying,
    off_placements,
    on_the_model,
    prediction_failed,
)
from ..analysis.answer.result import Result
from ..analysis.diagnostics.diagnosis import Explanation, undecided
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.displacement import Displacement
from ..analysis.misfit import (
    Criterion,
    ExactDoubted,
    LackOfFit,
    Misfit,
    NominalContradicted,
    PlacementsDisagree,
)
from ..analysis.observability.causes import (
    AsGoodAs,
    BaseFrame,
    Held,
    NoiseSplit,
    NullDirection,
    OnAxis,
    ToolRotation,
    worst_direction,
)
from ..analysis.observability.changes import ChangeAt, RunChange
from ..analysis.observability.power import DetectionPower
from ..analysis.recordings.steps import RecordingStep
from ..analysis.solution import ParameterResult, Solution
from ..analysis.status import Status, Verdict, known
from ..analysis.tight_priors import TightPrior
from ..model.files.header import Header
from ..model.files.run import in_no_file
from ..model.instruments.kind import Assumption
from ..model.instruments.registry import KINDS
from ..model.likelihood.parameters import HeldBy
from . import numbers
from .basis_words import basis_lines
from .controllers import export_command, export_sentence, lacks_factory_calibration, taken_by
from .enter import conformity_sentence, expected_sentence, met_words
from .finding_words import finding_sentence, likelihood_message
from .geometry_words import by_tolerances, confounded_sentence, worth_sentence
from .judgement import Judgement, against, judgement
from .misfit_causes import CAUSES, by_another_run, mend
from .misfit_words import (
    UNVALIDATED,
    cause_sentence,
    criterion_sentence,
    larger_tolerance,
    measurements,
    step_sentence,
)
from .observability import condition, direction_remedy, reason, stating, unnoticed_sentence
from .provenance import is_simulated
from .verdict import VERDICT_WORDS, assumed_steps, resting
from .wording import (
    NOT_DETERMINED,
    Namer,
    be,
    capital,
    clipped,
    counted,
    ended,
    listed,
    person,
    sentence,
    shown,
)

_ESTIMATE_LINKS = (
    "Remove geometry: exact from the header, so that the links are estimated, and analyse again."
)
_SAFE = re.compile(r"[\w./+@-]+")
_MOST_CAUTIONS = 6
_MOST_STEPS = 2  # that are no misfit
_MOST_ASKED = 2  # causes between which the measurements do not decide
_IN_THE_HEADER = (BaseFrame, Held, NoiseSplit, OnAxis, ToolRotation)  # mended there, not by a plan


@dataclass(frozen=True, eq=False, kw_only=True)
class _Case:
    """What a message is made of: of a result, or of a solution while its run is being measured, of which no
    `diagnosis` was made. `off` are placements that the others do not predict, `warnings` sentences that no
    finding says, `power` what a pass may not have noticed. `met` says of a pass whether the robot meets what
    it must, `expected` why; `unmet` unless it surely does."""

    verdict: Verdict
    stopped: str | None
    parameters: Sequence[ParameterResult]
    null_space: Sequence[NullDirection]
    misfit: Misfit | None
    k: float
    findings: Sequence[Finding]
    run: str
    header: Mapping[str, object]
    vendor: str | None = None
    diagnosis: Sequence[Explanation] | None = None
    off: Sequence[HoldOut] = ()
    warnings: Sequence[str] = ()
    power: Sequence[DetectionPower] = ()
    met: str | None = None
    unmet: bool = False
    expected: str | None = None

    @property
    def simulated(self) -> bool:
        """Whether no robot was measured."""
        provenance = self.header.get("provenance")
        return isinstance(provenance, Mapping) and is_simulated(provenance)

    @property
    def without_some(self) -> bool:
        """Whether measurements of a file were left out (`analyse --drop`)."""
        provenance = self.header.get("provenance")
        return isinstance(provenance, Mapping) and "without measurements" in provenance

    @property
    def offsets(self) -> list[ParameterResult]:
        """The offsets that are estimated."""
        return [row for row in self.parameters if row.group == "offset" and not row.held]

    @property
    def held(self) -> list[str]:
        """The offsets that the header holds, and not the method: others have to take up a wrong one. Not the
        last one of a free tool, which the tool takes up."""
        offsets = [row for row in self.parameters if row.group == "offset"]
        tool = self.header.get("tool")
        if isinstance(tool, Mapping) and tool.get("calibrated") is False:
            offsets = offsets[:-1]
        return [row.name for row in offsets if row.cause == Held("header")]

    def named(self, *status: Status) -> list[str]:
        """The offsets of these statuses."""
        return [row.name for row in self.offsets if row.status in status]

    @property
    def condition(self) -> str | None:
        """What a pass is subject to, after "if"; None without a pass or a condition."""
        return condition(self.power) if self.verdict == "pass" else None

    @property
    def worst(self) -> ParameterResult | None:
        """The least well determined offset, of those that are more than assumed; None without one that is
        estimated, or without an answer."""
        if self.misfit is not None or self.stopped is not None:
            return None
        determined = [row for row in self.offsets if row.status != "assumed"]
        return max(determined, key=lambda row: (row.std is None, row.std or 0.0), default=None)

    def u(self, row: ParameterResult) -> str:
        """Its expanded uncertainty."""
        return "" if row.std is None else numbers.spread(self.k * row.std, numbers.unit_of(row.unit))

    @property
    def doubt(self) -> Finding | HoldOut | None:
        """What comes before a pass: large residuals, other optima, targets or a placement that are off."""
        return against((*self.findings, *self.off))

    @property
    def judged(self) -> Judgement:
        """Its grade, and what may be done with it."""
        return judgement(
            self.verdict,
            contradicted=self.doubt is not None,
            converged=self.stopped is None,
            determined=any(known(row.status) for row in self.offsets),
            simulated=self.simulated,
            unmet=self.unmet,
            vendor=self.vendor,
            robot=self.header.get("robot"),
        )


def message(result: Result) -> Message:
    """The message of an answer."""
    effects = result.misfit is None and result.likelihood.converged
    basis = basis_lines(
        result.taken_as_known, result.inputs.header, result.coverage_factor, person, effects=effects
    )
    return replace(_message(_case(result), person), basis=basis)


def judged(result: Result) -> Judgement:
    """The grade of an answer, and what may be done with it."""
    return _case(result).judged


def message_so_far(solution: Solution, run: str, header: Header) -> Message:
    """The same while the measurements of a run, a file of that name, are being made."""
    return _message(_case_so_far(solution, run, header.model_dump(mode="json")), person)


def acceptance_plan_message(measurements: int, calibration: str, run: str) -> Message:
    """The message of a run that tests a corrected robot: its own offsets do not judge it."""
    return Message(
        verdict=f"{counted(measurements, 'measurement')} for the test of {shown(calibration)}.",
        worst=None,
        cause=None,
        action=Action(
            "Compare them with the calibration.",
            f"zerobeam verify {run_argument(calibration)} {run_argument(run)}",
        ),
        cautions=(),
    )


def lines_of(content: Message) -> list[str]:
    """A message as lines: verdict, cause, worst offset, what to do; cautions are left to a page."""
    action = content.action
    todo = f"To do: {action.text}" + ("" if action.command is None else f"  {action.command}")
    lines = [content.verdict, content.cause, None if content.worst is None else content.worst.text, todo]
    return [line for line in lines if line is not None]


def headline(result: Result, name: Namer = str) -> str:
    """Verdict and cause without the verdict's word; `name` writes names."""
    return _headline(_case(result), name)


def solution_headline(solution: Solution, name: Namer = str) -> str:
    """The same of a fit alone."""
    return _headline(_case_so_far(solution, "", {}), name)


def headline_so_far(solution: Solution, name: Namer = str) -> str:
    """The same while measurements are being made."""
    if not solution.converged:
        return "These measurements determine no offset yet."
    return solution_headline(solution, name)


def _headline(case: _Case, name: Namer) -> str:
    return " ".join(part for part in (_determined(case, name), _cause(case, name)) if part)


def _case(result: Result) -> _Case:
    inputs, fit = result.inputs, result.likelihood
    judged = result.conformity if result.verdict == "pass" else None
    after = None if result.entered is None else result.entered.tcp_after
    return _Case(
        verdict=result.verdict,
        stopped=None if fit.converged else fit.reason,
        parameters=result.parameters,
        null_space=result.identifiability.null_space,
        misfit=result.misfit,
        k=result.coverage_factor,
        findings=result.findings,
        run=inputs.run,
        header=inputs.header,
        vendor=inputs.vendor,
        diagnosis=result.diagnosis,
        off=off_placements(result.placements.leave_one_out),
        warnings=tuple(_warnings(result)),
        power=result.power,
        met=None if judged is None else met_words(judged),
        unmet=judged is not None and judged.decision != "conforms",
        expected=None if judged is None or after is None else expected_sentence(judged, after),
    )


def _case_so_far(solution: Solution, run: str, header: Mapping[str, object]) -> _Case:
    return _Case(
        verdict=solution.verdict,
        stopped=None if solution.converged else solution.fit.reason,
        parameters=solution.parameters,
        null_space=solution.null_space,
        misfit=solution.misfit,
        k=solution.coverage_factor,
        findings=tuple(on_the_model(solution)),
        power=solution.power,
        run=run,
        header=header,
    )


def _warnings(result: Result) -> Iterator[str]:
    """What a reader of a pass, or of less, must know besides the findings. Of a misfit nothing is said that
    follows from its model."""
    if result.misfit is not None or not result.likelihood.converged:
        return
    offsets = [
        row
        for row in result.parameters
        if row.group == "offset" and row.std is not None and row.status != "assumed"
    ]
    yield from map(step_sentence, result.placements.steps.rows[:_MOST_STEPS])
    if (unchecked := likelihood_message(result.likelihood)) is not None:
        yield f"{capital(unchecked)}."
    if result.verdict == "pass" and (missed := unnoticed_sentence(result.power)) is not None:
        yield missed
    if "required" in result.inputs.header and (result.verdict != "pass" or result.conformity is None):
        yield conformity_sentence(result)
    if not offsets:
        return
    worst = max(offsets, key=lambda row: row.std or 0.0)
    if result.geometry.tolerance is None:
        worth = worth_sentence(result.geometry, offsets, result.coverage_factor)
        yield from [] if worth is None else [worth]
    elif (why := confounded_sentence(result.geometry, worst.name, worst.tolerance_share, person)) is not None:
        yield why


def _message(case: _Case, name: Namer) -> Message:
    worst = case.worst
    return Message(
        verdict=f"{_judged(case)}. {_determined(case, name)}",
        worst=None if worst is None else _worst(case, worst, name),
        cause=_cause(case, name),
        action=_saved_first(case, _action(case)),
        cautions=tuple(ended(sentence(text)) for text in _cautions(case, name))[:_MOST_CAUTIONS],
        grade=case.judged.grade,
        may=case.judged.may,
    )


def _worst(case: _Case, row: ParameterResult, name: Namer) -> WorstOffset:
    return WorstOffset(
        name=row.name,
        value=None if row.std is None else case.k * row.std,
        unit=row.unit,
        text=f"Least well determined: {name(row.name)}, {_value(case, row)}.",
    )


def _judged(case: _Case) -> str:
    """The verdict's word, that of a simulated run as such; and whether the robot meets what it must."""
    word = VERDICT_WORDS[case.verdict]
    word = f"Simulated: {word.lower()}" if case.simulated else word
    run = prediction_failed(case.findings)
    if run is not None and case.verdict == "pass":
        return f"{word} of this run alone, but it does not predict {clipped(shown(run), 60)}: enter nothing"
    return word if case.met is None else f"{word}; {case.met}"


def _value(case: _Case, row: ParameterResult) -> str:
    if row.std is None or row.estimate is None:
        return NOT_DETERMINED
    unit, u = numbers.unit_of(row.unit), case.k * row.std
    return f"{numbers.estimate(row.estimate, u, unit)} ± {numbers.spread(u, unit)}"


def _determined(case: _Case, name: Namer) -> str:
    """What can be said of the offsets, the gravest first."""
    if case.stopped is not None:
        return f"The fit did not converge ({case.stopped}): no offset is reported."
    if case.misfit is not None:
        return f"The model does not describe the measurements. {capital(UNVALIDATED)}."
    lost, weak, known = case.named("unidentifiable"), case.named("weak"), case.named("identified")
    sentences = []
    if lost:
        sentences.append(f"{_are(lost, name)} unidentifiable from these measurements.")
    if weak:
        sentences.append(f"{_are(weak, name)} only weakly observable, {_within(case, weak)}.")
    if known:
        sentences.append(f"{_are(known, name)} identified, {_within(case, known, k_said=bool(weak))}.")
    sentences += resting(case.offsets, name)
    if case.verdict == "pass" and sentences:
        sentences += _held_words(case, name)
    return " ".join(sentences) or "No offset is estimated: all are held."


_HELD_BY: dict[HeldBy, str] = {
    "base frame": "base frame",
    "tool rotation": "free tool",
    "first link": "base frame",
    "free tool": "free tool",
    "header": "by the header",
}


def _held_words(case: _Case, name: Namer) -> Iterator[str]:
    """Whom a pass leaves out because it is held, and why."""
    parts = [
        f"{name(row.name)} held: {_HELD_BY[row.cause.by]}"
        for row in case.parameters
        if row.group == "offset" and isinstance(row.cause, Held)
    ]
    if parts:
        yield f"{'; '.join(parts)}."


def _are(names: Sequence[str], name: Namer) -> str:
    return f"{listed([name(each) for each in names])} {be(names)}"


def _within(case: _Case, names: Sequence[str], *, k_said: bool = False) -> str:
    """The expanded uncertainties of offsets; k where it has not been said."""
    rows = [row for row in case.offsets if row.name in names]
    parts = []
    for unit in dict.fromkeys(row.unit for row in rows):
        of_unit = sorted((row for row in rows if row.unit == unit), key=lambda row: row.std or 0.0)
        low, high = case.u(of_unit[0]), case.u(of_unit[-1])
        parts.append(high if low == high else f"{low} to {high}")
    return f"U {' and '.join(parts)}" + ("" if k_said else f" ({numbers.coverage(case.k)})")


def _cause(case: _Case, name: Namer) -> str | None:
    """What is wrong, or what limits the answer; None where nothing is and does."""
    text = _cause_words(case, name)
    return None if text is None else ended(sentence(capital(text)))


def _cause_words(case: _Case, name: Namer) -> str | None:
    if case.stopped is not None:
        return cause_sentence(case.diagnosis) if case.diagnosis else None
    if case.misfit is not None:
        held = ""
        if case.held:
            held = f"{_are(case.held, name)} held, not estimated: that alone can cause a misfit. "
        if case.diagnosis:
            return held + cause_sentence(case.diagnosis)
        first = _sharpest(case.misfit)
        text = criterion_sentence(first, name).removeprefix("Lack of fit: ")
        tried = case.diagnosis is not None and isinstance(first, LackOfFit)
        return held + (f"{text}. No cause that was tried explains it" if tried else text)
    if case.doubt is not None:
        return doubt_sentence(case.doubt, name)
    if (lost := case.named("unidentifiable")) or (lost := case.named("weak")):
        row = max((row for row in case.offsets if row.name in lost), key=lambda row: row.std or 0.0)
        cause = worst_direction(case.null_space, row.name).cause
        why = by_tolerances(cause, row.tolerance_share) or reason(cause, name)
        return f"{name(row.name)}: {why}" if row.status == "weak" else why
    limits = [case.expected, case.condition and f"This holds if {case.condition}"]
    return " ".join(each for each in limits if each) or None


_DISPLACED = (Displacement, RecordingStep)
_SHARPEST = (NominalContradicted, *_DISPLACED, TightPrior)


def _target(displaced: Displacement | RecordingStep) -> str:
    return displaced.target


def _sharpest(misfit: Misfit) -> Criterion:
    """The criterion that names most of what is wrong: links, a target that moved, a step, a tolerance, else
    the first."""
    for kind in _SHARPEST:
        for criterion in misfit.criteria:
            if isinstance(criterion, kind):
                return criterion
    return misfit.criteria[0]


def doubt_sentence(doubt: Finding | HoldOut, name: Namer = str) -> str:
    """What speaks against the values, without a full stop."""
    if not isinstance(doubt, HoldOut):
        return finding_sentence(doubt, name)
    residual, expected = (
        numbers.or_words(value, "unknown", "mm") for value in (doubt.rms_mm, doubt.expected_mm)
    )
    return (
        f"Placement {clipped(doubt.placements[0])} does not agree with the others: by their offsets its"
        f" residuals are {residual} rms, {expected} expected"
    )


def _saved_first(case: _Case, action: Action) -> Action:
    """The same, where a command needs a file and the run is in none."""
    if action.command is None or not case.run or not in_no_file(case.run):
        return action
    file = run_argument(case.run)
    by_command = f"--save {file}, or " if case.without_some else ""
    save = f'Save the run first: {by_command}solution.run.write("{file}").'
    return Action(f"{action.text} {save}", action.command)


def _action(case: _Case) -> Action:
    run = run_argument(case.run)
    again = f"zerobeam analyse {run}"
    if case.stopped is not None and case.diagnosis:
        elsewhere = by_another_run(case.diagnosis[0])
        return Action(f"Enter nothing. {mend(case.diagnosis[0])}", None if elsewhere else again)
    if case.stopped is not None:
        return Action(
            "Enter nothing: look for a wrong measurement, or state a better guess of target and tool.", again
        )
    if case.misfit is not None:
        if case.held:
            estimate = f"Enter nothing. Estimate {listed([person(each) for each in case.held])} too."
            return Action(f"{estimate} If the misfit stays: {_mend(case)}", again)
        best = case.diagnosis[0] if case.diagnosis else None
        if best is not None and best.cause == "measurements" and not in_no_file(case.run):
            again += f" --drop {','.join(map(str, best.measurements))}"
        elsewhere = bool(case.diagnosis) and all(map(by_another_run, _named(case.diagnosis or ())))
        return Action(f"Enter nothing. {_mend(case)}", None if elsewhere else again)
    if (doubt := case.doubt) is not None:
        return Action(check_first(doubt), _plan(case) if isinstance(doubt, OtherBasins) else again)
    if (lost := case.named("unidentifiable")) or (lost := case.named("weak")):
        row = max((row for row in case.offsets if row.name in lost), key=lambda row: row.std or 0.0)
        direction = worst_direction(case.null_space, row.name)
        planned = not isinstance(direction.cause, _IN_THE_HEADER)
        todo = direction_remedy(direction, person)
        return Action(f"Enter nothing yet: {todo}.", _plan(case) if planned else again)
    if case.verdict != "pass" and (assumed := _assumed(case)):
        more = "or record more measurements, in varied postures"
        return Action(f"Enter nothing yet: {stating(assumed)}, {more}.", again)
    if case.verdict != "pass":
        return Action("Enter nothing yet: record more measurements, in varied postures.", _plan(case))
    if not case.offsets:
        return Action("Enter nothing: no offset is estimated.", None)
    if case.simulated:
        return Action(
            "Enter nothing: no robot was measured. Measure your robot, by this plan or a new plan.",
            _plan(case),
        )
    if lacks_factory_calibration(case.vendor, robot := case.header.get("robot")):
        return Action(
            "Enter nothing yet: the controller computes with the arm's factory calibration, and this run was"
            " analysed with the nominal arm, so that the values would apply that calibration twice. Make a"
            " robot file of it, name it as robot of the run, and analyse again.",
            f"zerobeam import ur-calibration calibration.conf --robot {robot} -o my-{robot}.yaml",
        )
    command, file = export_command(case.vendor)
    enter = export_sentence(case.vendor)
    if case.unmet:
        values = "values are" if taken_by(case.vendor) == "offsets" else "offsets alone are"
        enter += f" The {values} not enough for the requirement: do not release the robot with them."
    return Action(enter, f"zerobeam {command} {run} -o {file}")


def _assumed(case: _Case) -> list[Assumption]:
    """What offsets rest on that nobody stated or measured."""
    of = [row.cause.of for row in case.offsets if isinstance(row.cause, AsGoodAs) and not row.cause.by_header]
    return list(dict.fromkeys(one for some in of for one in some))


def _named(diagnosis: Sequence[Explanation]) -> Sequence[Explanation]:
    """The explanations whose remedies are said: the best, or those between which nothing decides."""
    return undecided(diagnosis)[:_MOST_ASKED] or diagnosis[:1]


def _mend(case: _Case) -> str:
    assert case.misfit is not None
    if case.diagnosis:
        first, *others = _named(case.diagnosis)
        if not others:
            return mend(first)
        return " ".join(f"If it is {CAUSES[one.cause]}: {mend(one)}" for one in (first, *others))
    match _sharpest(case.misfit):
        case Displacement(station=True) as at:
            return (
                f"Record the run again with {clipped(at.target)} and the arm's base fixed, or analyse the"
                f" measurements up to {at.after_shot} and those from {at.before_shot} on each alone."
            )
        case Displacement() as at:
            return (
                f"Give {clipped(at.target)} another name in the measurements from {at.before_shot} on, or"
                " record the run again."
            )
        case RecordingStep(target=target) as step:
            fixed = f"{clipped(target)} and the arm's base" if step.station else "the target"
            return (
                f"Remove {measurements(step.first_shot, step.last_shot)} of {clipped(target)} from the run,"
                f" or record them again with {fixed} fixed."
            )
        case NominalContradicted():
            return _ESTIMATE_LINKS
        case TightPrior() as prior:
            return larger_tolerance(prior)
        case RunChange(elsewhere=elsewhere) as at:
            what = list(dict.fromkeys([_changed(at), *map(_changed, elsewhere[: _MOST_ASKED - 1])]))
            return f"Look for what changed {' or '.join(what)} during the run, and record the run again."
        case _ if case.diagnosis is None:
            return "Analyse the run: that says what could be wrong."
        case _:
            return "Check joint columns, signs, units, targets and geometry, then measure again."


def _changed(at: ChangeAt) -> str:
    return "the target" if at.joint is None else f"the zero of J{at.joint} (belt, coupling, encoder)"


def check_first(doubt: Finding | HoldOut) -> str:
    """What to do about it."""
    match doubt:
        case OtherBasins():
            return "Enter nothing: record more measurements, in varied postures."
        case ExactDoubted():
            return f"Enter nothing yet. {_ESTIMATE_LINKS}"
        case HeldOutMisfit(run=str()):
            return "Enter nothing yet: look for what differs in the held-out run."
        case HeldOutMisfit():
            return "Enter nothing yet: look for what differs at the held-out target."
        case HoldOut(placements=names):
            return f"Check placement {clipped(names[0])} before you enter anything: measure there again."
        case _:
            return "Check these measurements before you enter anything: remove them, or repeat them."


def _plan(case: _Case) -> str | None:
    """The command that plans measurements by the run's instrument, None where it has several, or a tool that
    has several targets."""
    targets, stations = case.header.get("targets") or {}, case.header.get("instruments") or {}
    if not case.run or not isinstance(targets, dict) or not isinstance(stations, dict):
        return None
    if stations:
        planned = len(stations) == 1 and case.header.get("tool") is None
        known = all(isinstance(row, dict) and row.get("guess_mm") for row in targets.values())
        command = f"zerobeam plan optimal --header {run_argument(case.run)} -o plan.yaml"
        return command if planned and known else None
    if len(targets) != 1:
        return None
    ((target, target_row),) = targets.items()
    guess = target_row.get("guess_mm") if isinstance(target_row, dict) else None
    if target not in {kind.target for kind in KINDS.values()} or not isinstance(guess, list | tuple):
        return None
    coordinates = ",".join(f"{float(value):g}" for value in guess)
    return f"zerobeam plan optimal --header {run_argument(case.run)} --target={coordinates} -o plan.yaml"


def run_argument(name: str) -> str:
    """The run's file for a command, or of a run in memory the one to write it to; a stand-in where the name
    holds what a shell would read."""
    if not _SAFE.fullmatch(name):
        return "RUN.jsonl"
    return shlex.quote(f"{name}.jsonl" if in_no_file(name) else name)


def _cautions(case: _Case, name: Namer) -> Iterator[str]:
    """What a reader must not miss besides the cause, the gravest first."""
    yield from _evidence(case, case.misfit, name) if case.misfit is not None else _reservations(case, name)
    yield from (one.text for one in case.findings if isinstance(one, FileWarning))


def _evidence(case: _Case, misfit: Misfit, name: Namer) -> Iterator[str]:
    """What else of the measurements speaks against the model; nothing that follows from it."""
    best = case.diagnosis[0] if case.diagnosis else None
    cause = _sharpest(misfit) if best is None else None
    moved = best.targets if best is not None and best.cause == "moved_target" else ()
    for one in misfit.criteria:
        displaced = isinstance(one, _DISPLACED) and _target(one) not in moved
        if one is not cause and (displaced or isinstance(one, PlacementsDisagree)):
            yield criterion_sentence(one, name)
    if best is None:
        yield from (finding_sentence(one, name) for one in case.findings if isinstance(one, Outlying))


def _reservations(case: _Case, name: Namer) -> Iterator[str]:
    """What an answer is subject to."""
    cause = case.doubt
    yield from assumed_steps(case.offsets, name)
    for finding in case.findings:
        if finding is not cause and not isinstance(finding, NotConverged | FileWarning):
            yield finding_sentence(finding, name)
    for placement in case.off:
        if placement is not cause:
            yield doubt_sentence(placement, name)
    yield from case.warnings
