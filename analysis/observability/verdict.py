"""The verdict over the offsets, and the words in which it is told."""

from __future__ import annotations

import math

from ...model.parameters import Parameter
from ...model.problem import Problem
from ..result import NullDirection, Status, Verdict
from .identifiability import Identified


def verdict(problem: Problem, identified: Identified) -> Verdict:
    """Over the offsets that are not held: degenerate if any is unidentifiable."""
    if offsets_with(problem, identified, "unidentifiable"):
        return "degenerate"
    return "weak" if offsets_with(problem, identified, "weak") else "pass"


def offsets_with(problem: Problem, identified: Identified, status: Status) -> list[str]:
    """Names of the offsets with a status."""
    return [
        item.name
        for item, own in zip(problem.parameters.items, identified.status, strict=True)
        if item.group == "offset" and own == status
    ]


def verdict_sentence(problem: Problem, identified: Identified) -> str:
    """The verdict in one or two sentences, with the reason where it is not a pass."""
    unknown = offsets_with(problem, identified, "unidentifiable")
    weak = offsets_with(problem, identified, "weak")
    known = offsets_with(problem, identified, "identified")
    sentences = []
    if unknown:
        reasons = dict.fromkeys(worst_direction(identified, name).reason for name in unknown)
        sentences.append(f"{_are(unknown)} not determined by these shots: {'; '.join(reasons)}.")
    if weak:
        sentences.append(f"{_are(weak)} only weakly determined by these shots.")
    if known:
        sentences.append(f"{_are(known)} identified.")
    return " ".join(sentences) or "No offset is estimated: all are held."


def worst_direction(identified: Identified, name: str) -> NullDirection:
    """The direction that a weak or unidentifiable parameter owes its state to."""
    taking_part = [d for d in identified.facts.null_space if name in d.combination]
    if not taking_part:
        return NullDirection(
            {name: 1.0}, "noise", "the noise hides it", "add shots, or measure with less noise"
        )
    return max(taking_part, key=lambda direction: _share(direction, name))


def _share(direction: NullDirection, name: str) -> float:
    """Std that the direction gives to one of its parameters, in prior stds (infinite for a gauge)."""
    if direction.data_std is None:
        return math.inf
    weights = direction.combination
    return abs(weights[name]) * direction.data_std / math.hypot(*weights.values())


def reason_for(identified: Identified, item: Parameter, status: Status) -> str | None:
    """Why a parameter has no number, or a poor one; None for an identified one."""
    if status == "held":
        return item.held_reason
    return None if status == "identified" else worst_direction(identified, item.name).reason


def listed(names: list[str]) -> str:
    """a, b and c."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _are(names: list[str]) -> str:
    return f"{listed(names)} {'is' if len(names) == 1 else 'are'}"
