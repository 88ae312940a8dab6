"""Verdicts and what a check says of a plan, in words: each sentence is made here, and nowhere read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ...analysis.observability.causes import NullDirection
from ...analysis.observability.check import Check, OutsideLimits, PlanFinding, TargetBehind, Unreachable
from ...analysis.observability.verdict import worst_direction
from ...analysis.status import Status, Verdict
from .causes import reason
from .wording import Namer, listed

VERDICT_WORDS: dict[Verdict, str] = {
    "pass": "Pass",
    "weak": "Weak",
    "degenerate": "Degenerate",
    "misfit": "Misfit",
}


class _Row(Protocol):
    """A parameter of a result, of a check, of a run that is not finished."""

    @property
    def name(self) -> str: ...
    @property
    def group(self) -> str: ...
    @property
    def status(self) -> Status: ...


def verdict_sentence(
    parameters: Sequence[_Row], null_space: Sequence[NullDirection], name: Namer = str
) -> str:
    """What can be said of the offsets, the gravest first."""

    def offsets(status: Status) -> list[str]:
        return [row.name for row in parameters if row.group == "offset" and row.status == status]

    unknown, weak, identified = offsets("unidentifiable"), offsets("weak"), offsets("identified")
    unvalidated = offsets("unvalidated")
    sentences = []
    if unknown:
        reasons = dict.fromkeys(reason(worst_direction(null_space, own).cause, name) for own in unknown)
        sentences.append(
            f"{_are(unknown, name)} unidentifiable from these measurements: {'; '.join(reasons)}."
        )
    if weak:
        sentences.append(f"{_are(weak, name)} only weakly observable in these measurements.")
    if identified:
        sentences.append(f"{_are(identified, name)} identified.")
    if unvalidated:
        sentences.append(f"{_are(unvalidated, name)} unvalidated.")
    return " ".join(sentences) or "No offset is estimated: all are held."


def _are(names: list[str], name: Namer) -> str:
    return f"{listed([name(own) for own in names])} {'is' if len(names) == 1 else 'are'}"


def check_headline(check: Check, name: Namer = str) -> str:
    """What a plan will determine, in one or two sentences; `name` writes names."""
    return verdict_sentence(check.parameters, check.identifiability.null_space, name)


def check_notes(check: Check) -> tuple[str, ...]:
    """The findings of a plan and the warnings of its file, as sentences without a full stop."""
    return (*(_plan_sentence(finding) for finding in check.findings), *check.warnings)


def _plan_sentence(finding: PlanFinding) -> str:
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
                f"Turned onto the target, joint {joint} of posture {posture} is at {at:.1f} {unit}, outside"
                f" {low:.0f} to {high:.0f}{counting and f' ({counting})'}"
            )
