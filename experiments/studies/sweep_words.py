"""What follows from a study over a grid of settings, in sentences made of its numbers alone."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from ...analysis.observability.verdict import listed

Json = dict[str, Any]


def headline(axes: Sequence[Json], cases: Sequence[Json]) -> str:
    """Best and worst, which cases tell nothing, whether the runs agree."""
    parts = [_range(cases), _without_number(axes, cases), _without_plan(axes, cases), _agreement(cases)]
    return " ".join(part for part in parts if part)


def findings(axes: Sequence[Json], cases: Sequence[Json]) -> list[str]:
    """What each axis does, and what the midpoint fit costs; a sentence each, without the full stop."""
    found = []
    for i, axis in enumerate(axes):
        numbers = all(isinstance(value, int | float) for value in axis["values"])
        found.append(_trend(i, axis, cases) if numbers else _by_word(i, axis, cases))
    return [sentence.rstrip(".") for sentence in (*found, _midpoint(cases)) if sentence]


def plain(value: float) -> str:
    """A number that was stated, with a minus that is one."""
    return f"{value:g}".replace("-", "\u2212")


def two_digits(value: float) -> str:
    """Two significant digits, never with an exponent."""
    return f"{Decimal(f'{value:.2g}'):f}"


def _range(cases: Sequence[Json]) -> str:
    told = [case for case in cases if case["worst_std"] is not None]
    if not told:
        return "No case tells all its offsets."
    best, worst = (pick(told, key=lambda case: float(case["worst_std"])) for pick in (min, max))
    text = f"The worst offset is told best with {best['words']}: to {two_digits(best['worst_std'])}°"
    if best is worst:
        return f"{text}."
    poorest = f"{worst['words']}: to {two_digits(worst['worst_std'])}°"
    return f"{text}; poorest, of those that tell all, with {poorest}."


def _by_word(i: int, axis: Json, cases: Sequence[Json]) -> str:
    """The range of the worst std at each value of an axis of words."""
    parts = []
    for j, value in enumerate(axis["values"]):
        own = [case for case in cases if case["at"][i] == j]
        stds = [case["worst_std"] for case in own if case["worst_std"] is not None]
        if not stds:
            parts.append(f"{value} never tells them all")
            continue
        low, high = two_digits(min(stds)), two_digits(max(stds))
        parts.append(f"{value} {low}°" if low == high else f"{value} {low} to {high}°")
    some = any(case["worst_std"] is not None for case in cases)
    return f"By {axis['label']}: {'; '.join(parts)}." if some and len(parts) > 1 else ""


def _trend(i: int, axis: Json, cases: Sequence[Json]) -> str:
    """By what factor the worst std changes from the lowest to the highest value of an axis of numbers."""
    values = axis["values"]
    rows: dict[tuple[int, ...], dict[int, float]] = {}
    for case in cases:
        if case["worst_std"] is not None:
            others = tuple(case["at"][:i] + case["at"][i + 1 :])
            rows.setdefault(others, {})[case["at"][i]] = case["worst_std"]
    ends = {
        others: (min(own, key=lambda j: values[j]), max(own, key=lambda j: values[j]))
        for others, own in rows.items()
        if len(own) > 1
    }
    if not ends:
        return ""
    (first, last), count = Counter(ends.values()).most_common(1)[0]
    factors = [
        rows[others][last] / rows[others][first] for others, own in ends.items() if own == (first, last)
    ]
    low, middle, high = (two_digits(float(np.quantile(factors, q))) for q in (0, 0.5, 1))
    spread = "" if count == 1 or low == high else f" (median; {low} to {high} over the other settings)"
    unit = f" {axis['unit']}" if axis["unit"] else ""
    return (
        f"With {axis['label']} from {plain(values[first])} to {plain(values[last])}{unit} the worst std"
        f" changes by a factor of {middle}{spread}."
    )


def _without_number(axes: Sequence[Json], cases: Sequence[Json]) -> str:
    those = [case for case in cases if case["verdict"] == "degenerate"]
    if not those:
        return ""
    return f"{_counted(those, cases)} degenerate and without a number{_all_with(axes, cases, those)}."


def _without_plan(axes: Sequence[Json], cases: Sequence[Json]) -> str:
    those = [case for case in cases if case["reason"] is not None]
    if not those:
        return ""
    return f"{_counted(those, cases)} without a plan{_all_with(axes, cases, those)}."


def _counted(those: Sequence[Json], cases: Sequence[Json]) -> str:
    return f"{len(those)} of {len(cases)} cases {'is' if len(those) == 1 else 'are'}"


def _all_with(axes: Sequence[Json], cases: Sequence[Json], those: Sequence[Json]) -> str:
    """', among them all with …': the values of axes at which every case is one of those."""
    names: list[str] = []
    if len(those) == len(cases):
        return ""
    for i, axis in enumerate(axes):
        for j, value in enumerate(axis["values"]):
            own = [case for case in cases if case["at"][i] == j]
            if 1 < len(own) == sum(case["at"][i] == j for case in those):
                unit = f" {axis['unit']}" if axis["unit"] else ""
                names.append(value if isinstance(value, str) else f"{axis['label']} {plain(value)}{unit}")
    return f", among them all with {listed(names)}" if names else ""


def _midpoint(cases: Sequence[Json]) -> str:
    ratios = [
        row["midpoint"]["rmse"] / row["likelihood"]["rmse"]
        for case in cases
        for row in case["parameters"]
        if row["midpoint"] is not None and row["likelihood"] is not None
    ]
    if not ratios:
        return ""
    low, middle, high = (two_digits(float(np.quantile(ratios, q))) for q in (0, 0.5, 1))
    return (
        f"The midpoint fit has {middle} times the error of the likelihood (median; {low} to {high} over"
        " cases and parameters)."
    )


def _agreement(cases: Sequence[Json]) -> str:
    judged = [case for case in cases if any(row["likelihood"] is not None for row in case["parameters"])]
    if not judged:
        return ""
    parts = []
    for those, which in (
        ([case for case in judged if case["verdict"] != "degenerate"], "cases"),
        ([case for case in judged if case["verdict"] == "degenerate"], "degenerate cases"),
    ):
        off = [case["words"] for case in those if _contradicts(case)]
        some = listed(off[:3]) + (f" and {len(off) - 3} more" if len(off) > 3 else "") if off else ""
        if off:
            told = f"{len(off)} of {len(those)} {which}: {some}"
            parts.append(f"The simulated runs contradict what is predicted in {told}.")
        elif which == "cases" and those:
            told = "" if len(those) == len(judged) else " that are not degenerate"
            parts.append(f"The simulated runs agree with what is predicted in all {len(those)} cases{told}.")
    failed = sum(case["failed"] for case in cases)
    return " ".join([*parts, *([f"Fits that failed: {failed}."] if failed else [])])


def _contradicts(case: Json) -> bool:
    return any(
        row["likelihood"] is not None and not row["likelihood"]["agrees"] for row in case["parameters"]
    )
