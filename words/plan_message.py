"""The one message of a plan: what it will determine, how well, what limits it, what to do."""

from __future__ import annotations

import shlex
from collections.abc import Iterator

from ..analysis.answer.answer_message import Action, Message, WorstOffset
from ..analysis.observability.causes import AsGoodAs, Tried, worst_direction
from ..analysis.observability.check import Check, CheckedParameter
from ..analysis.status import Status
from . import numbers
from .geometry_words import by_tolerances
from .observability import (
    condition,
    direction_remedy,
    over_target_sentence,
    power_sentences,
    reason,
    stating,
)
from .verdict import VERDICT_WORDS, assumed_steps, check_notes, resting, violation_words
from .wording import be, capital, counted, ended, listed, person, sentence

COVERAGE = 2.0  # k of the expanded uncertainties that a plan promises
_MOST_CAUTIONS = 6
_DETERMINED: tuple[Status, ...] = ("identified", "weak", "unidentifiable")  # or not, but by measurements


def plan_message(check: Check) -> Message:
    """The message of a plan; broken constraints come before all else."""
    worst = max(
        _offsets(check, *_DETERMINED), key=lambda row: (row.std is None, row.std or 0.0), default=None
    )
    cause = _cause(check)
    return Message(
        verdict=f"{VERDICT_WORDS[check.verdict]}. {_determined(check)}",
        worst=None if worst is None else _worst(worst),
        cause=None if cause is None else ended(sentence(capital(cause))),
        action=plan_action(check),
        cautions=tuple(ended(sentence(text)) for text in _cautions(check))[:_MOST_CAUTIONS],
    )


def _offsets(check: Check, *status: Status) -> list[CheckedParameter]:
    rows = [row for row in check.parameters if row.group == "offset" and not row.held]
    return [row for row in rows if not status or row.status in status]


def _worst(row: CheckedParameter) -> WorstOffset:
    value = None if row.std is None else COVERAGE * row.std
    known = (
        "not determined by this plan"
        if value is None
        else f"U {numbers.spread(value, numbers.unit_of(row.unit))} ({numbers.coverage(COVERAGE)})"
    )
    return WorstOffset(row.name, value, row.unit, f"Least well determined: {person(row.name)}, {known}.")


def _determined(check: Check) -> str:
    """What a run of the plan will determine, the gravest first."""
    sentences = []
    if check.violations:
        broken = sorted({each.posture for each in check.violations})
        verb = "break" if len(broken) > 1 else "breaks"
        sentences.append(
            f"{len(broken)} of {counted(len(check.postures), 'posture')} {verb} the constraints of the plan."
        )
    texts: dict[Status, str] = {
        "unidentifiable": "unidentifiable by this plan",
        "weak": "only weakly observable",
        "identified": "identified",
    }
    for status, text in texts.items():
        if names := [person(row.name) for row in _offsets(check, status)]:
            sentences.append(f"{listed(names)} {be(names)} {text}.")
    sentences += resting(_offsets(check), person)
    return " ".join(sentences) or "No offset is estimated: all are held."


def _limiting(check: Check) -> CheckedParameter | None:
    """The offset that a weak or degenerate plan owes its verdict to."""
    rows = _offsets(check, "unidentifiable") or _offsets(check, "weak")
    return max(rows, key=lambda row: (row.std is None, row.std or 0.0), default=None)


def tried_change(check: Check) -> Tried | None:
    """The change of the postures that the message of a weak or degenerate plan suggests; None where it
    suggests none."""
    row = _limiting(check)
    tried = None if row is None else worst_direction(check.identifiability.null_space, row.name).tried
    return None if tried is None or tried.joint is None else tried


def _cause(check: Check) -> str | None:
    if check.violations:
        first = check.violations[0]
        return f"posture {first.posture}: {violation_words(first)}"
    row = _limiting(check)
    if row is not None:
        cause = worst_direction(check.identifiability.null_space, row.name).cause
        return f"{person(row.name)}: {by_tolerances(cause, row.tolerance_share) or reason(cause, person)}"
    subject_to = condition(check.power)
    return None if subject_to is None else f"a pass of such a run holds if {subject_to}"


def plan_action(check: Check) -> Action:
    """What to do with a plan, and the command that makes another where some postures are no measurements."""
    return Action(ended(sentence(_action(check))), _made_anew(check) if check.violations else None)


def _made_anew(check: Check) -> str | None:
    """The command that plans as many measurements by the plan's header; None for several instruments."""
    header = check.aimed.plan.header
    if len(header.labels) > 1:
        return None
    plan = shlex.quote(check.inputs.plan)
    return f"zerobeam plan optimal --header {plan} --shots {len(check.postures)} -o new-plan.yaml"


def _action(check: Check) -> str:
    if check.violations:
        broken = sorted({each.posture for each in check.violations})
        noun = "posture" if len(broken) == 1 else "postures"
        loosen = (
            "" if all(each.condition == "arm" for each in check.violations) else ", or loosen the constraint"
        )
        counted_from = "the plan's first posture is 0"
        return (
            f"Change or remove {noun} {listed([str(i) for i in broken])} ({counted_from}){loosen}, or make"
            " another plan"
        )
    row = _limiting(check)
    if row is None:
        assumed = [row.cause.of for row in _offsets(check, "assumed") if isinstance(row.cause, AsGoodAs)]
        if assumed and not _offsets(check, "identified"):
            return capital(stating(assumed[0]))
        measure = "Nothing needs to change. Measure by this plan"
        return measure if _offsets(check) else "Estimate an offset: leave it out of `held`"
    return capital(direction_remedy(worst_direction(check.identifiability.null_space, row.name), person))


def _cautions(check: Check) -> Iterator[str]:
    """What a reader must not miss besides the cause, the gravest first."""
    yield from check_notes(check)[1 if check.violations else 0 :]
    yield from assumed_steps(_offsets(check), person)
    yield from filter(None, [over_target_sentence(check)])
    yield from (text for text in power_sentences(check.power) if "may not detect" in text)
