"""What is observable, and what would make more of it so, in words: directions, rank, a plan's outlook."""

from __future__ import annotations

from collections.abc import Mapping

from ..analysis.observability.causes import NullDirection
from ..analysis.observability.identifiability import Identifiability
from ..analysis.observability.outlook import Advice, OverTarget
from . import numbers
from .wording import label, listed, shown

_MOST_TERMS = 6


def combination_words(combination: Mapping[str, float]) -> str:
    """A direction as a sum of parameters, weights in prior standard deviations, the largest first."""
    weights = sorted(combination.items(), key=lambda item: -abs(item[1]))
    terms = [
        ("" if i == 0 and weight > 0 else "+ " if weight > 0 else f"{numbers.MINUS} ")
        + ("" if abs(weight) == 1 else f"{numbers.significant(abs(weight), 2)}\u00a0")
        + label(name, 24)
        for i, (name, weight) in enumerate(weights[:_MOST_TERMS])
    ]
    more = len(weights) - _MOST_TERMS
    return " ".join(terms) + (f" and {more} smaller" if more > 0 else "")


def direction_kind(direction: NullDirection) -> str:
    """How badly the data determine a direction."""
    if direction.kind == "exact":
        return "exact null-space direction: no number of such measurements determines it"
    if direction.kind == "optima":
        return "not decided: the way from the best local optimum to another that explains the data as well"
    if direction.data_std is None or direction.data_std >= 1:
        return "not resolvable at this noise level: the data say less than the prior"
    share = numbers.significant(direction.data_std, 2)
    return f"weakly observable: its uncertainty is {share} of the prior"


def rank_facts(facts: Identifiability) -> list[tuple[str, str]]:
    """Rank, condition number and observability indices, as names and texts."""
    rank = f"{facts.rank} of {facts.size} (whitened, scaled by the priors)"
    rank += "; singular, so no condition number" if facts.condition is None else ""
    rows = [("Rank of the Jacobian", rank)]
    if facts.condition is not None:
        rows.append(("Condition number", numbers.significant(facts.condition)))
    indices = {name: value for name, value in facts.observability.items() if value is not None}
    parts = [f"{shown(name)}\u00a0{numbers.significant(value)}" for name, value in indices.items()]
    text = ", ".join(parts)
    missing = [shown(name) for name in facts.observability if name not in indices]
    if missing:
        text += f"{'; ' if text else ''}{listed(missing)} not defined: the matrix is singular"
    return [*rows, ("Observability indices", text)] if text else rows


def advice_sentence(advice: Advice) -> str:
    """The change of a plan that helps most."""
    what = "as one more measurement" if advice.add else "in its place"
    return (
        f"The single change that helps most: posture {advice.posture} with joint {advice.joint} rotated"
        f" by {numbers.exact(advice.change_deg, advice.unit)}, {what}: the largest standard"
        f" uncertainty falls from {numbers.spread(advice.worst_std_before, advice.unit)}"
        f" to {numbers.spread(advice.worst_std_after, advice.unit)}."
    )


def over_target_sentence(over: OverTarget, units: Mapping[str, str]) -> str:
    """What becomes of a plan if the target is not at its nominal place; `units` by parameter."""
    name, worst = max(over.worst_std.items(), key=lambda item: item[1])
    return (
        f"With the target anywhere within its stated sigma ({over.draws} draws), {over.hit:.0%} of the"
        f" measurements hit, and the largest standard uncertainty is that of {label(name)}:"
        f" {numbers.spread(worst, units[name])}."
    )
