"""What the data cannot tell, and what would help."""

from __future__ import annotations

from typing import Any

from ..style.blocks import Direction, Directions, Facts
from ..words import numbers
from ..words.wording import label, listed, sentence, shown
from .view_parameters import NOT_DETERMINED

Json = dict[str, Any]

MOST_TERMS = 6


def unknown(result: Json) -> Json:
    untold = [label(row["name"]) for row in result["parameters"] if row["status"] == "unidentifiable"]
    weak = [label(row["name"]) for row in result["parameters"] if row["status"] == "weak"]
    facts = result["identifiability"]
    items = [direction_words(direction) for direction in facts["null_space"]]
    if untold:
        verb = "is" if len(untold) == 1 else "are"
        said = f"{listed(untold)} {verb} {NOT_DETERMINED}. No value is given, since any would be made up."
    elif items:
        said = "Every parameter that was not held has an estimate, but some combinations are poorly told."
    else:
        said = "Nothing that was asked for: every parameter that was not held is told by the data."
    if weak:
        said += f" Told only weakly, beyond the tolerance: {listed(weak)}."
    condition = facts["condition"]
    told = f"{facts['rank']} of {facts['size']} (whitened, scaled by the priors)"
    told += "; singular, so no condition number" if condition is None else ""
    rows = [("Rank of the Jacobian", told)]
    if condition is not None:
        rows.append(("Condition number", numbers.significant(condition)))
    indices = {name: value for name, value in facts["observability"].items() if value is not None}
    told = ", ".join(f"{shown(name)}\u00a0{numbers.significant(value)}" for name, value in indices.items())
    missing = [shown(name) for name in facts["observability"] if name not in indices]
    if missing:
        told += f"{'; ' if told else ''}{listed(missing)} not defined: the matrix is singular"
    if told:
        rows.append(("Observability indices", told))
    return {"sentence": said, "directions": Directions(items), "facts": Facts(rows)}


def advice_words(advice: Json) -> str:
    """The change of a plan that helps most, in a sentence."""
    what = "one more shot" if advice["add"] else "in its place"
    return (
        f"The single change that helps most: posture {advice['posture']} with joint {advice['joint']} turned"
        f" by {numbers.exact(advice['change_deg'], advice['unit'])}, as {what}: the worst standard"
        f" deviation falls from {numbers.spread(advice['worst_std_before'], advice['unit'])}"
        f" to {numbers.spread(advice['worst_std_after'], advice['unit'])}."
    )


def over_target_words(over: Json) -> str:
    """What becomes of a plan where its target stands elsewhere, in a sentence."""
    name, worst = max(over["worst_std"].items(), key=lambda item: float(item[1]))
    return (
        f"With the target anywhere within its stated sigma ({over['draws']} draws), {over['hit']:.0%} of the"
        f" shots hit and the worst is {label(name)} at {numbers.spread(worst)}."
    )


def direction_words(direction: Json) -> Direction:
    weights = sorted(direction["combination"].items(), key=lambda item: -abs(item[1]))
    terms = [
        ("" if i == 0 and weight > 0 else "+ " if weight > 0 else f"{numbers.MINUS} ")
        + ("" if abs(weight) == 1 else f"{numbers.significant(abs(weight), 2)}\u00a0")
        + label(name, 24)
        for i, (name, weight) in enumerate(weights[:MOST_TERMS])
    ]
    more = len(weights) - MOST_TERMS
    return Direction(
        combination=" ".join(terms) + (f" and {more} smaller" if more > 0 else ""),
        kind=direction_kind(direction),
        reason=sentence(direction["reason"]),
        remedy=sentence(direction["remedy"]),
    )


def direction_kind(direction: Json) -> str:
    """How badly the data tell a direction, in words."""
    if direction["kind"] == "exact":
        return "exact: no number of such shots tells it"
    told = direction["data_std"]
    if told is None or told >= 1:
        return "lost in the noise: the data say less than was known before"
    share = numbers.significant(told, 2)
    return f"blurred by the noise: the data narrow it only to {share} of what was known before"
