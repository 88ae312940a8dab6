"""What is found in a run, an entry each, from the gravest down. What speaks against the model silences what
follows from the model.

A finding is data of `analysis`, or what a function here finds in an answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ..analysis.answer.findings import (
    FileWarning,
    HeldOutMisfit,
    NoPosterior,
    NotConverged,
    OtherBasins,
    Outlying,
    PoorCurvature,
    RobustNotConverged,
    RoundedAngles,
)
from ..analysis.answer.result import Result
from ..analysis.diagnostics.diagnosis import BEYOND_TOLERANCES, Explanation
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.misfit import (
    BeyondPrior,
    ExactDoubted,
    ImplausibleNoise,
    LackOfFit,
    NominalContradicted,
    PlacementsDisagree,
    TightPrior,
)
from ..analysis.observability.causes import (
    BaseFrame,
    Held,
    NoiseSplit,
    OnAxis,
    ToolRotation,
)
from ..analysis.observability.changes import ChangeAt, Displacement, RepeatsApart, RepeatsDiffer, RunChange
from ..analysis.recordings.steps import RecordingStep
from ..analysis.status import known
from ..model.files.run import in_no_file
from ..model.instruments.kind import Assumption
from . import numbers
from .case import RunCase
from .controllers import export_command, export_sentence, lacks_factory_calibration, taken_by
from .enter import beyond_offsets_sentence, conformity_sentence, expected_sentence
from .entries import (
    About,
    FindingEntry,
    FindingRow,
    Open,
    assumed_of,
    holding,
    if_,
    open_directions,
    rows_of,
    some,
    why_each,
    why_open,
)
from .finding_words import finding_sentence, likelihood_message, small_residuals
from .geometry_words import confounded_sentence, with_own_u, worth_sentence
from .misfit_words import (
    CAUSES,
    alternatives,
    by_another_run,
    cause_sentence,
    larger_tolerance,
    measurements,
    mend,
    step_sentence,
)
from .observability import (
    assumed_steps,
    condition,
    direction_remedy,
    remaining,
    remedy,
    stating,
)
from .outlook_words import BetterPostures, better_postures, plan_command
from .provenance import left_out, rig_words
from .wording import are, capital, clipped, listed, person


@dataclass(frozen=True)
class SaidToEnterNothing:
    """A result of an earlier version says that nothing is to be entered, and not why."""


def against(findings: Iterable[object]) -> FindingRow | None:
    """The gravest of the findings that speak against values although the model describes the measurements,
    with its entry; None where nothing does."""
    every = tuple(findings)
    stops = [entry for entry in RUN if entry.grade == "stop" and entry.about != "model"]
    return next(
        (FindingRow(entry, one) for entry in stops for one in every if type(one) is entry.finding), None
    )


def open_rows(case: RunCase) -> list[FindingRow]:
    """Of offsets that the measurements do not determine, or only weakly: the gravest first."""
    return [row for row in rows_of(case, RUN) if isinstance(row.finding, Open)]


# Of the model


_MOST_NAMED = 2  # causes between which the measurements do not decide
_ESTIMATE_LINKS = (
    "Remove geometry: exact from the header (of a run its first line), so that the links are estimated, and"
    " analyse again."
)


def _finding(finding: Any, case: RunCase) -> str:
    """What is said of a finding everywhere."""
    return finding_sentence(finding, case.name)


def _again(finding: object, case: RunCase) -> str:
    return case.again


def _plan(finding: object, case: RunCase) -> str | None:
    return case.plan


def _held(case: RunCase) -> Iterator[list[str]]:
    if case.misfit is not None and case.held:
        yield case.held


def _held_sentence(names: list[str], case: RunCase) -> str:
    return f"{are(names, case.name)} held, not estimated: that alone can cause a misfit."


def _after_held(mended: Callable[[Any, RunCase], str]) -> Callable[[Any, RunCase], str]:
    """What mends a model; offsets that the header holds are to be estimated first."""

    def remedy(finding: Any, case: RunCase) -> str:
        named = [listed(list(map(person, names))) for names in _held(case)]
        first = "".join(f"Estimate {names} too. If the misfit stays: " for names in named)
        return f"Enter nothing. {first}{mended(finding, case)}"

    return remedy


def _diagnosed(case: RunCase) -> Iterator[Sequence[Explanation]]:
    if not case.sound and case.diagnosis:
        yield case.diagnosis


def _likely(diagnosis: Sequence[Explanation]) -> Sequence[Explanation]:
    """The explanations whose remedies are said: the best, or those between which nothing decides."""
    return alternatives(diagnosis)[:_MOST_NAMED] or diagnosis[:1]


_LARGER = {*BEYOND_TOLERANCES, "noise"}
_LOOK = "Check joint columns, signs, units, tool, targets and geometry, then measure again."


def _mend_causes(diagnosis: Sequence[Explanation], case: RunCase) -> str:
    if all(one.cause in _LARGER and not one.agrees for one in _likely(diagnosis)):
        return _LOOK  # no tolerance and no noise is so large
    remedies = {mend(one): CAUSES[one.cause] for one in _likely(diagnosis)}
    if len(remedies) == 1:
        return next(iter(remedies))
    return " ".join(f"If it is {cause}: {remedy}" for remedy, cause in remedies.items())


def _analyse_mended(diagnosis: Sequence[Explanation], case: RunCase) -> str | None:
    first, *others = _likely(diagnosis)
    if all(map(by_another_run, (first, *others))):
        return None
    dropped = first.cause == "measurements" and not in_no_file(case.run)
    return case.again + (f" --drop {','.join(map(str, first.measurements))}" if dropped else "")


def _look(criterion: object, case: RunCase) -> str:
    if case.diagnosis is None:
        return "Analyse the run: that says what could be wrong."
    return _LOOK


def _criterion(
    kind: type, mended: Callable[[Any, RunCase], str] = _look, **more: Any
) -> FindingEntry[RunCase]:
    """A criterion of a misfit: the cause where there is no diagnosis."""
    usual: dict[str, Any] = {
        "sentence": _finding,
        "place": "cause",
        "command": _again,
        "silences": frozenset({"values"}),
    }
    return FindingEntry(kind, "stop", remedy=_after_held(mended), about="model", **(usual | more))


def _lack_of_fit(misfit: LackOfFit, case: RunCase) -> str:
    text = finding_sentence(misfit, case.name).removeprefix("Lack of fit: ")
    return text if case.diagnosis is None else f"{text}. No cause that was tried explains it"


def _moved(kind: type[Displacement] | type[RecordingStep]) -> Callable[[RunCase], Iterator[Any]]:
    """The targets that moved, but for those that the diagnosis names or that only seem to by what it leaves
    out."""

    def find(case: RunCase) -> Iterator[Any]:
        best = case.diagnosis[0] if case.diagnosis else None
        named = best.targets if best is not None and best.cause == "moved_target" else ()
        wrong = best.measurements if best is not None and best.cause == "measurements" else ()
        for one in case.findings:
            if isinstance(one, kind) and one.target not in named and not _only_by(one, wrong):
                yield one

    return find


def _only_by(moved: Displacement | RecordingStep, wrong: Sequence[int]) -> bool:
    """Whether a target may seem to have moved by single measurements that are wrong."""
    if isinstance(moved, Displacement):
        return moved.alone in wrong
    return any(moved.first_shot <= number <= moved.last_shot for number in wrong)


def _analyse_apart(moved: Displacement, case: RunCase) -> str:
    target = clipped(moved.target)
    if moved.station:
        return (
            f"Record the run again with {target} and the arm's base fixed, or analyse the measurements up to"
            f" {moved.after_shot} and those from {moved.before_shot} on each alone."
        )
    return (
        f"Give {target} another name in the measurements from {moved.before_shot} on, or record the run"
        " again."
    )


def _record_again(step: RecordingStep, case: RunCase) -> str:
    fixed = f"{clipped(step.target)} and the arm's base" if step.station else "the target"
    return (
        f"Remove {measurements(step.first_shot, step.last_shot)} of {clipped(step.target)} from the run, or"
        f" record them again with {fixed} fixed."
    )


def _look_for_change(change: RunChange, case: RunCase) -> str:
    what = dict.fromkeys(map(_changed, (change, *change.elsewhere[: _MOST_NAMED - 1])))
    return f"Look for what changed {' or '.join(what)} during the run, and record the run again."


def _mend_repeats(apart: RepeatsApart, case: RunCase) -> str:
    if case.diagnosis:
        return _mend_causes(case.diagnosis, case)
    moved = next((one for one in case.findings if isinstance(one, Displacement)), None)
    when = f"before measurement {apart.again[0]}"
    if moved is not None:
        when = f"between measurements {moved.after_shot} and {moved.before_shot}"
    return f"Look for what changed (target, instrument, arm) {when}, and record the run again."


def _repeats_sentence(apart: RepeatsApart, case: RunCase) -> str | None:
    if case.diagnosis and case.diagnosis[0].cause == "units":
        return None  # in the right unit they are no repeats
    return f"{_finding(apart, case)}."


def _analyse_repeats(apart: RepeatsApart, case: RunCase) -> str | None:
    return _analyse_mended(case.diagnosis, case) if case.diagnosis else None


def _measure_again(change: RepeatsDiffer, case: RunCase) -> str:
    look = f"look for what changed {_changed(change)}, and record the run again."
    if _measured_twice(change):
        return f"Enter nothing: {look}"
    again = measurements(change.again[0], change.again[-1])
    how = "with the plan and the options of this run" if _planned(case) else "as further measurements"
    return (
        f"Enter nothing yet: measure the postures of {again} once more, {how}. If they differ again, {look}"
    )


def _once_more(change: RepeatsDiffer, case: RunCase) -> str | None:
    if _measured_twice(change) or not _planned(case):
        return None
    cell = ["--cell", "CELL"] if "cell sha256" in case.provenance else []
    rig = " ".join([*cell, *(rig_words(case.provenance) or ["--rig", "RIG"])])
    return f"zerobeam run PLAN -o {case.argument} {rig} --resume --once-more"


def _measured_twice(change: RepeatsDiffer) -> bool:
    return len(set(change.repeated)) < len(change.repeated)


def _planned(case: RunCase) -> bool:
    """Whether the run was recorded by a plan: it can go on."""
    return "plan sha256" in case.provenance and not in_no_file(case.run)


def _changed(at: ChangeAt) -> str:
    return "the target" if at.joint is None else f"the zero of J{at.joint} (belt, coupling, encoder)"


# Of the values


_MOST_STEPS = 2  # that are no misfit
_IN_THE_HEADER = (BaseFrame, Held, NoiseSplit, OnAxis, ToolRotation)  # mended there, not by a plan


def _placement_off(placement: HoldOut, case: RunCase) -> str:
    residual, expected = (
        numbers.or_words(value, "unknown", "mm") for value in (placement.rms_mm, placement.expected_mm)
    )
    return (
        f"Placement {clipped(placement.placements[0])} does not agree with the others: by their offsets its"
        f" residuals are {residual} rms, {expected} expected"
    )


def _check_placement(placement: HoldOut, case: RunCase) -> str:
    name = clipped(placement.placements[0])
    return f"Check placement {name} before you enter anything: measure there again."


def _look_at_held_out(misfit: HeldOutMisfit, case: RunCase) -> str:
    where = "at the held-out target" if misfit.run is None else "in the held-out run"
    return f"Enter nothing yet: look for what differs {where}."


def _determine(one: Open, case: RunCase) -> str:
    better = _better_postures(one, case)
    if better is None:
        postures = one.direction.tried is not None and one.direction.tried.how != "tolerances"
        other = " Or plan the best postures." if postures and case.plan else ""
        return f"Enter nothing yet: {direction_remedy(one.direction, person)}.{other}"
    return f"Enter nothing yet: {better.text}."


def _better_postures(one: Open, case: RunCase) -> BetterPostures | None:
    outlook = None if case.result is None else case.result.outlook
    return None if isinstance(one.direction.cause, _IN_THE_HEADER) else better_postures(outlook, one.row)


def _plan_or_again(one: Open, case: RunCase) -> str | None:
    if isinstance(one.direction.cause, _IN_THE_HEADER):
        return case.again
    better = _better_postures(one, case)
    if better is not None:
        return plan_command(case.planned, better.row)
    tried = one.direction.tried
    return case.again if tried is not None and tried.how == "tolerances" else case.plan


def _assumed_alone(case: RunCase) -> Iterator[list[Assumption]]:
    assumed = list(dict.fromkeys(one for of in assumed_of(case.offsets) for one in of))
    if case.verdict != "pass" and assumed:
        yield assumed


def _state(assumed: list[Assumption], case: RunCase) -> str:
    return f"Enter nothing yet: {stating(assumed)}, or record more measurements, in varied postures."


def nominal_arm(case: RunCase) -> bool:
    """Whether a robot was measured whose controller computes with another arm than the run's."""
    return not case.simulated and lacks_factory_calibration(case.vendor, case.header.get("robot"))


def _import_calibration(nominal: object, case: RunCase) -> str:
    robot = case.header.get("robot")
    return f"zerobeam import ur-calibration calibration.conf --robot {robot} -o my-{robot}.yaml"


def _export(finding: object, case: RunCase) -> str:
    text = export_sentence(case.vendor)
    if not case.falls_short:
        return text
    if case.conformity is None:
        return f"{text} Whether they are enough for the requirement cannot be said: do not release the robot."
    values = "values are" if taken_by(case.vendor) == "offsets" else "offsets alone are"
    return f"{text} The {values} not enough for the requirement: do not release the robot with them."


def _export_command(finding: object, case: RunCase) -> str:
    command, file = export_command(case.vendor)
    return f"zerobeam {command} {case.argument} -o {file}"


def _expected(case: RunCase) -> Iterator[str]:
    after = None if case.result is None or case.result.entered is None else case.result.entered.tcp_after
    if case.conformity is not None and case.result is not None and after is not None:
        yield expected_sentence(case.conformity, after, case.result.region)
        yield from some(beyond_offsets_sentence(case.result))


def _conditions(case: RunCase) -> Iterable[str]:
    return some(condition(case.power)) if case.verdict == "pass" else ()


def _besides(made: Callable[[Result, RunCase], Iterable[str]]) -> Callable[[RunCase], Iterable[str]]:
    """Sentences that are made of a whole answer."""
    return lambda case: made(case.result, case) if case.sound and case.result is not None else ()


def _slips(result: Result, case: RunCase) -> Iterable[str]:
    return map(step_sentence, result.placements.steps.rows[:_MOST_STEPS])


def _unchecked(result: Result, case: RunCase) -> Iterable[str]:
    return map(capital, some(likelihood_message(result.likelihood)))


def _unnoticed(result: Result, case: RunCase) -> Iterable[str]:
    return remaining(case.power) if case.verdict == "pass" else ()


def _unjudged(result: Result, case: RunCase) -> Iterable[str]:
    judged = "required" not in result.inputs.header or case.conformity is not None
    return () if judged else (conformity_sentence(result),)


def _worth(result: Result, case: RunCase) -> Iterable[str]:
    """What the offsets are worth with the geometry taken otherwise, or why they are known no better."""
    if result.geometry.tolerance is None:
        return some(worth_sentence(result.geometry, case.offsets, result.coverage_factor))
    worst = max(with_own_u(case.offsets), key=lambda row: row.std or 0.0, default=None)
    if worst is None:
        return ()
    share = worst.tolerance_share
    return some(confounded_sentence(result.geometry, worst.name, share, person))


_VALUES: frozenset[About] = frozenset({"values"})


def _mend_stopped(_: object, case: RunCase) -> str:
    if case.too_few is not None:
        return f"Enter nothing: {remedy(case.too_few)}."
    return "Enter nothing: look for a wrong measurement, or state a better guess of target and tool."


RUN: tuple[FindingEntry[RunCase], ...] = (
    FindingEntry(
        "held offsets", "stop", _held_sentence, place="before the cause", about="model", found=_held
    ),
    _criterion(
        RepeatsApart,
        _mend_repeats,
        sentence=_repeats_sentence,
        command=_analyse_repeats,
        place="before the cause",
    ),
    FindingEntry(
        "a diagnosis",
        "stop",
        lambda diagnosis, case: cause_sentence(diagnosis),
        _after_held(_mend_causes),
        _analyse_mended,
        place="cause",
        about="model",
        silences=frozenset({"values", "measurements"}),
        found=_diagnosed,
    ),
    FindingEntry(
        NotConverged,
        "stop",
        remedy=_mend_stopped,
        command=lambda _, case: case.again if case.too_few is None else case.plan,
        place="nowhere",  # the verdict says it
        about="model",
        silences=_VALUES,
        found=lambda case: map(NotConverged, some(case.stopped)),
    ),
    _criterion(NominalContradicted, lambda one, case: _ESTIMATE_LINKS),
    _criterion(Displacement, _analyse_apart, place="cause or caution", found=_moved(Displacement)),
    _criterion(RecordingStep, _record_again, place="cause or caution", found=_moved(RecordingStep)),
    _criterion(TightPrior, lambda prior, case: larger_tolerance(prior)),
    _criterion(LackOfFit, sentence=_lack_of_fit),
    _criterion(ImplausibleNoise),
    _criterion(BeyondPrior),
    _criterion(PlacementsDisagree, place="cause or caution"),
    _criterion(RunChange, _look_for_change),
    # What speaks against the values, whatever the verdict.
    FindingEntry(
        RoundedAngles,
        "stop",
        _finding,
        remedy=(
            "Enter nothing yet: correct these angles in the robot's file (pi / 2 is 1.570796327), and analyse"
            " again. An angle that was measured is stated to six decimals of a radian."
        ),
        command=_again,
        about="file",
    ),
    FindingEntry(
        OtherBasins,
        "stop",
        _finding,
        remedy="Enter nothing: record more measurements, in varied postures.",
        command=_plan,
        colour="weak",
    ),
    FindingEntry(
        ExactDoubted,
        "stop",
        _finding,
        remedy=f"Enter nothing yet. {_ESTIMATE_LINKS}",
        command=_again,
        colour="weak",
    ),
    FindingEntry(
        RepeatsDiffer,
        "stop",
        _finding,
        _measure_again,
        _once_more,
        about="measurements",
        colour="weak",
    ),
    FindingEntry(HeldOutMisfit, "stop", _finding, remedy=_look_at_held_out, command=_again, colour="weak"),
    FindingEntry(
        Outlying,
        "stop",
        _finding,
        remedy="Check these measurements before you enter anything: remove them, or repeat them.",
        command=_again,
        about="measurements",
        colour="weak",
    ),
    FindingEntry(HoldOut, "stop", _placement_off, _check_placement, _again, colour="weak"),
    FindingEntry(SaidToEnterNothing, "stop", place="nowhere", colour="weak"),
    # What the measurements do not determine.
    FindingEntry(
        "nothing is determined",
        "stop",
        found=if_(lambda case: bool(case.offsets) and not any(known(row.status) for row in case.offsets)),
    ),
    FindingEntry(
        "an unidentifiable offset",
        "doubt",
        lambda one, case: why_each(one, case.name),
        _determine,
        _plan_or_again,
        place="cause",
        found=lambda case: open_directions(case.offsets, case.null_space, "unidentifiable"),
    ),
    FindingEntry(
        "a weak offset",
        "doubt",
        lambda one, case: f"{case.name(one.row.name)}: {why_open(one, case.name)}",
        _determine,
        _plan_or_again,
        place="cause",
        found=lambda case: open_directions(case.offsets, case.null_space, "weak"),
    ),
    FindingEntry("assumed offsets alone", "doubt", None, _state, _again, found=_assumed_alone),
    FindingEntry(
        "no pass",
        "doubt",
        remedy="Enter nothing yet: record more measurements, in varied postures.",
        command=_plan,
        found=if_(lambda case: case.verdict != "pass"),
    ),
    # Of a pass: why nothing is entered all the same, what it is subject to.
    FindingEntry(
        "no offset is estimated",
        "stop",
        remedy="Enter nothing: no offset is estimated.",
        colour="held",
        found=if_(lambda case: not case.offsets),
    ),
    FindingEntry(
        "no robot was measured",
        "doubt",
        remedy="Enter nothing: no robot was measured. Plan and measure your own.",
        command=_plan,
        found=if_(lambda case: case.simulated),
    ),
    FindingEntry(
        "no factory calibration",
        "doubt",
        remedy=(
            "Enter nothing yet: the controller computes with the arm's factory calibration, and this run was"
            " analysed with the nominal arm, so that the values would apply that calibration twice. Make a"
            " robot file of it, name it as robot of the run, and analyse again."
        ),
        command=_import_calibration,
        colour="weak",
        found=if_(nominal_arm),
    ),
    FindingEntry(
        "a controller that takes no offsets",
        "doubt",
        None,
        _export,
        _export_command,
        found=if_(lambda case: taken_by(case.vendor) != "offsets"),
    ),
    FindingEntry(
        "measurements that were left out",
        "note",
        lambda text, case: f"Left out by a person: {text}",
        about="measurements",
        found=lambda case: left_out(case.provenance),
    ),
    FindingEntry(
        "a requirement that may not be met",  # the verdict says it
        "note",
        colour="weak",
        found=if_(lambda case: case.falls_short),
    ),
    FindingEntry("the error to expect", "note", place="before the cause", found=_expected),
    FindingEntry("conditions of a pass", "note", holding("Holds"), place="cause", found=_conditions),
    FindingEntry("values to enter", "note", None, _export, _export_command, found=if_(lambda case: True)),
    # Said besides.
    FindingEntry("assumed offsets", "note", found=lambda case: assumed_steps(case.offsets, case.name)),
    FindingEntry(NoPosterior, "note", _finding),
    FindingEntry(PoorCurvature, "note", _finding),
    FindingEntry(RobustNotConverged, "note", _finding),
    FindingEntry(
        "slips within a recording",
        "note",
        found=_besides(_slips),
    ),
    FindingEntry(
        "a fit that nothing checks",
        "note",
        found=_besides(_unchecked),
    ),
    FindingEntry("what a pass does not exclude", "note", found=_besides(_unnoticed)),
    FindingEntry("a requirement that cannot be judged", "note", found=_besides(_unjudged)),
    FindingEntry("what the geometry does", "note", found=_besides(_worth)),
    FindingEntry(
        "residuals that are far too small",
        "note",
        found=_besides(lambda result, case: small_residuals(result.likelihood)),
    ),
    FindingEntry(FileWarning, "note", _finding, about="file"),
)
