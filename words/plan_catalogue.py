"""What is found in a plan that was checked, an entry each, from the gravest down; its message and headline;
what its postures break.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from ..analysis.answer.answer_message import Action, May, Message
from ..analysis.observability.causes import NullDirection, Tried, worst_direction
from ..analysis.observability.check import (
    Check,
    CheckedParameter,
    Condition,
    OutsideLimits,
    PlanFinding,
    TargetBehind,
    Unreachable,
    Violation,
)
from ..analysis.observability.outlook import COVERAGE, Outlook
from ..analysis.status import Status
from ..model.instruments.kind import Assumption
from . import numbers
from .entries import (
    NONE_ESTIMATED,
    VERDICT_WORDS,
    FindingEntry,
    Open,
    assumed_of,
    holding,
    if_,
    message_by,
    open_directions,
    rows_of,
    some,
    why_each,
    why_open,
    worst_of,
)
from .observability import (
    assumed_steps,
    condition,
    determined,
    direction_remedy,
    helps_little,
    leaves_weak,
    over_target_sentence,
    reason,
    remaining,
    stating,
)
from .outlook_words import (
    BetterPostures,
    better_postures,
    plan_command,
    required_remedy,
    short_sentence,
    short_words,
    within_reach,
)
from .trust import verdict_sentence
from .wording import WEAK, Namer, capital, counted, ended, listed, path_argument, person, sentence

_BROKEN: dict[Condition, str] = {
    "behind": "the target is behind the laser",
    "itself": "the arm hits itself",
    "cell": "the arm hits the floor or a box",
    "beam": "a box is in the beam's way",
    "sight": "a box is in the line of sight",
}


def violation_words(violation: Violation) -> str:
    """What a posture breaks of its plan's constraints, without the posture's number."""
    at_value, lowest, highest = violation.at, violation.lowest, violation.highest
    where = "" if violation.via is None else f"intermediate posture {violation.via}: "
    if violation.why is not None:
        return f"{where}{violation.why}"
    if violation.condition == "arm" and at_value is not None and lowest is not None:
        link = f"link {violation.joint}" if violation.joint else "the base"
        apart, radius = (numbers.exact(round(value), "mm") for value in (at_value, lowest))
        assumed = ", assumed: state it by `bodies` of the robot file" if violation.assumed else ""
        return (
            f"{where}{link} of the arm is in the way: the line to the target passes {apart} from its axis"
            f" (radius {radius}{assumed})"
        )
    if at_value is None or lowest is None or highest is None:
        planned = ", before the wrist is rotated onto the target" if violation.planned else ""
        return f"{where}{_BROKEN[violation.condition]}{planned}"
    unit = violation.unit or ""
    at, low, high = (numbers.exact(round(value, 2), unit) for value in (at_value, lowest, highest))
    match violation.condition:
        case "facing":
            side = "from behind, " if at_value > 90 else ""
            return f"the beam meets the target's face {side}at {at} to its normal (at most {high} allowed)"
        case "beam_mm" if at_value <= 0:
            return _BROKEN["behind"]
        case "beam_mm":
            return f"the beam is {at} long ({low} to {high} allowed)"
        case _:
            return f"joint {violation.joint} is at {at}; with the margin its limits are {low} to {high}"


def check_notes(check: Check) -> tuple[str, ...]:
    """Broken constraints and findings of a plan and the warnings of its file, as sentences without a full
    stop."""
    return (
        *map(violation_sentence, check.violations),
        *map(plan_sentence, check.findings),
        *check.warnings,
    )


def violation_sentence(violation: Violation) -> str:
    """What a posture breaks, with its number."""
    unseen = ": no measurement is counted there" if violation.unseen else ""
    return f"Posture {violation.posture}: {violation_words(violation)}{unseen}"


def plan_sentence(finding: PlanFinding) -> str:
    """A finding of a check, without a full stop."""
    match finding:
        case Unreachable(postures):
            return (
                f"From posture {listed([str(i) for i in postures], 99)} the target cannot be hit: no"
                " measurement is counted there"
            )
        case TargetBehind(_, every=True):
            return "Every target is behind the laser: is the sign of tool.direction right?"
        case TargetBehind(postures, _):
            return (
                f"In posture {listed([str(i) for i in postures], 99)} the target is behind the laser: no"
                " measurement is counted there"
            )
        case OutsideLimits(posture, joint, at, unit, (low, high), counting):
            return (
                f"Rotated onto the target, joint {joint} of posture {posture} is at {at:.1f} {unit}, outside"
                f" {low:.0f} to {high:.0f}{counting and f' ({counting})'}"
            )


def estimated(check: Check) -> list[CheckedParameter]:
    """The offsets that a run of the plan estimates."""
    return [row for row in check.parameters if row.group == "offset" and not row.held]


def _open_in(status: Status) -> Callable[[Check], Iterator[Open]]:
    return lambda check: open_directions(estimated(check), check.identifiability.null_space, status)


def _why_open_in(one: Open, check: Check) -> str:
    return f"{person(one.row.name)}: {why_open(one, person)}"


def _why_each_in(one: Open, check: Check) -> str:
    return why_each(one, person, named=True)


def _change_plan(one: Open, check: Check) -> str:
    better = _better_postures(one, check)
    if better is not None:
        return capital(better.text)
    text, at_once = capital(direction_remedy(one.direction, person)), _at_once(one, check)
    return text if at_once is None else f"{text}. Or {at_once.text}"


def _better_postures(one: Open, check: Check) -> BetterPostures | None:
    """Where no change of one posture or joint is known to help enough."""
    return better_postures(check.outlook, one.row) if helps_little(one.direction) else None


def _at_once(one: Open, check: Check) -> BetterPostures | None:
    """The same where the change determines what was not determined, and leaves it weak."""
    return better_postures(check.outlook, one.row) if leaves_weak(one.direction) else None


def _plan_changed(one: Open, check: Check) -> str | None:
    better = _better_postures(one, check) or _at_once(one, check)
    return None if better is None else plan_command(planned_anew(check), better.row)


def _change_postures(first: Violation, check: Check) -> str:
    broken = sorted({each.posture for each in check.violations})
    noun = "posture" if len(broken) == 1 else "postures"
    arm_alone = all(each.condition == "arm" for each in check.violations)
    return (
        f"Change or remove {noun} {listed([str(i) for i in broken])} (the plan's first posture is 0)"
        f"{'' if arm_alone else ', or loosen the constraint'}, or make another plan"
    )


def planned_anew(check: Check) -> str | None:
    """The command that plans by the plan's header, without options; None for several instruments."""
    if len(check.aimed.plan.header.labels) > 1:
        return None
    return f"zerobeam plan optimal --header {path_argument(check.inputs.plan)}"


def _made_anew(first: Violation, check: Check) -> str | None:
    """The command that plans as many measurements."""
    command = planned_anew(check)
    return None if command is None else f"{command} --shots {len(check.postures)} -o new-plan.yaml"


def _assumed_in(check: Check) -> Iterator[tuple[Assumption, ...]]:
    rows = estimated(check)
    if all(row.status != "identified" for row in rows):
        yield from assumed_of(rows)[:1]


def _short_of_required(check: Check) -> Iterator[Outlook]:
    if check.falls_short and check.outlook is not None:
        yield check.outlook


def _required_planned(outlook: Outlook, check: Check) -> str | None:
    reaching = within_reach(outlook)
    return None if reaching is None else plan_command(planned_anew(check), reaching.row)


PLAN: tuple[FindingEntry[Check], ...] = (
    FindingEntry(
        "a broken constraint",
        "stop",
        lambda first, check: f"posture {first.posture}: {violation_words(first)}",
        _change_postures,
        _made_anew,
        colour="misfit",
        found=lambda check: check.violations[:1],
    ),
    FindingEntry(
        "more broken constraints",
        "stop",
        lambda each, check: violation_sentence(each),
        place="caution",
        found=lambda check: check.violations[1:],
    ),
    FindingEntry(
        "an unidentifiable offset",
        "doubt",
        _why_each_in,
        _change_plan,
        _plan_changed,
        place="cause",
        found=_open_in("unidentifiable"),
    ),
    FindingEntry(
        "a weak offset",
        "doubt",
        _why_open_in,
        _change_plan,
        _plan_changed,
        place="cause",
        found=_open_in("weak"),
    ),
    FindingEntry(
        "assumed offsets alone",
        "doubt",
        None,
        lambda assumed, check: capital(stating(assumed)),
        found=_assumed_in,
    ),
    FindingEntry(
        "no offset is estimated",
        "doubt",
        remedy="Estimate an offset: leave it out of `held`",
        found=if_(lambda check: not estimated(check)),
    ),
    FindingEntry(
        "a requirement that is not met",
        "doubt",
        lambda outlook, check: short_sentence(outlook),
        lambda outlook, check: required_remedy(outlook),
        _required_planned,
        colour="weak",
        found=_short_of_required,
    ),
    FindingEntry(
        "conditions of a pass",
        "note",
        holding("a pass of such a run holds"),
        place="cause",
        found=lambda check: some(condition(check.power)),
    ),
    FindingEntry(
        "a plan as it is",
        "note",
        remedy="Nothing needs to change. Measure by this plan",
        found=if_(lambda check: True),
    ),
    *(
        FindingEntry(kind, "note", lambda one, check: plan_sentence(one))
        for kind in (Unreachable, TargetBehind, OutsideLimits)
    ),
    FindingEntry("warnings of the file", "note", found=lambda check: check.warnings),
    FindingEntry("assumed offsets", "note", found=lambda check: assumed_steps(estimated(check), person)),
    FindingEntry("the target elsewhere", "note", found=lambda check: some(over_target_sentence(check))),
    FindingEntry(
        "what a run may not show",
        "note",
        found=lambda check: remaining(check.power) if check.verdict == "pass" else (),
    ),
)


# The message


def plan_message(check: Check) -> Message:
    def value(row: Any) -> str:
        if row.std is None:
            return "not determined by this plan"
        u = numbers.spread(COVERAGE * row.std, numbers.unit_of(row.unit))
        return f"U {u} ({numbers.coverage(COVERAGE)})"

    word = f"{VERDICT_WORDS[check.verdict]}{f'. {_broken(check)}' if check.violations else ''}"
    for outlook in _short_of_required(check) if check.verdict == "pass" else ():
        word += f"; {short_words(outlook)}"
    rows = estimated(check)
    verdict = verdict_sentence(word, check.verdict, rows, COVERAGE)
    known_rows = [row for row in rows if row.status != "assumed"]
    content = message_by(check, PLAN, verdict, worst_of(known_rows, COVERAGE, value))
    action = Action(ended(sentence(content.action.text)), content.action.command)
    return replace(content, action=action, may=May())


def _broken(check: Check) -> str:
    """How many postures break constraints; nothing where none does."""
    broken = {each.posture for each in check.violations}
    if not broken:
        return ""
    verb = "breaks" if len(broken) == 1 else "break"
    return f"{len(broken)} of {counted(len(check.postures), 'posture')} {verb} the constraints of the plan"


def plan_headline(check: Check, name: Namer) -> str:
    because = determined_because(check.parameters, check.identifiability.null_space, name)
    if not check.violations:
        return because
    first = check.violations[0]
    unseen = all(any(each.unseen for each in posture.violations) for posture in check.postures)
    return (
        f"{_broken(check)}, first posture {first.posture}: {violation_words(first)}."
        f" {'No posture gives a measurement; if each did: ' if unseen else ''}{because}"
    )


def determined_because(
    parameters: Sequence[Any], null_space: Sequence[NullDirection], name: Namer = str
) -> str:
    """What can be said of the offsets, the gravest first, with the reasons of what is unidentifiable."""
    rows = [row for row in parameters if row.group == "offset"]
    open_ = [row.name for row in rows if row.status == "unidentifiable"]
    reasons = dict.fromkeys(reason(worst_direction(null_space, each).cause, name) for each in open_)
    texts: dict[Status, str] = {
        "unidentifiable": f"unidentifiable from these measurements: {'; '.join(reasons)}",
        "weak": f"only {WEAK} in these measurements",
        "identified": "identified",
        "unvalidated": "unvalidated",
    }
    return determined(rows, texts, name) or NONE_ESTIMATED


def tried_change(check: Check) -> Tried | None:
    """The change of the postures that the message of a weak or degenerate plan suggests; None where it
    suggests none."""
    open_ = next((row.finding for row in rows_of(check, PLAN) if isinstance(row.finding, Open)), None)
    if open_ is None or _better_postures(open_, check) is not None:
        return None
    tried = open_.direction.tried
    return None if tried is None or tried.joint is None else tried
