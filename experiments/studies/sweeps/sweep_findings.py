"""The findings of a study over a grid of settings, in sentences made of its numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from ....analysis.estimation.fit import CONTRADICTED, MANY_STARTS
from ....words.numbers import exact, significant, spread
from ....words.wording import listed
from .grid_answer import GridAxis, GridCase, GridSettings

_MOST_NAMED = 3  # cases that contradict their prediction


def headline(axes: Sequence[GridAxis], cases: Sequence[GridCase], beside: Sequence[GridCase] = ()) -> str:
    """The best and the worst case, the cases without a number, and whether the runs agree."""
    degenerate = [case for case in cases if case.verdict == "degenerate"]
    without_plan = [case for case in cases if case.reason is not None]
    parts = [
        _range(cases),
        _counted(axes, cases, degenerate, "degenerate: not all offsets are identifiable"),
        _counted(axes, cases, without_plan, "without a plan"),
        *_agreement((*cases, *beside)),
    ]
    return " ".join(part for part in parts if part)


def findings(axes: Sequence[GridAxis], cases: Sequence[GridCase]) -> list[str]:
    """The effect of each axis, and what the midpoint fit costs; a sentence each, without the full stop."""
    by_axis = [
        _by_word(i, axis, cases) if axis.numeric is None else _trend(i, axis, axis.numeric, cases)
        for i, axis in enumerate(axes)
    ]
    return [sentence for sentence in (*by_axis, _midpoint(cases)) if sentence]


def notes(settings: GridSettings, cases: Sequence[GridCase]) -> list[str]:
    """How the numbers were made and judged."""
    sentences = [
        "The predicted standard uncertainty u of a parameter is that of the fit of one run, priors included."
        " The least certain offset of a case is the one with the largest u; a case with an unidentifiable"
        " offset has none"
    ]
    parameters = [one for case in cases for one in case.parameters]
    if any(one.likelihood for one in parameters):
        sentences += [
            "Every simulated run has an arm of its own, a random draw from the priors: offsets with a"
            f" standard deviation of {exact(settings.prior.offset_deg, 'deg')}, the target with"
            f" {exact(settings.target.sigma_mm, 'mm')} in each direction about its nominal position, unless"
            " an axis changes them. The random numbers of a case follow from its settings and the seed",
            *_on_geometry(settings),
            f"A case agrees if the share of {settings.level:.0%} intervals that contain the true value and"
            f" the scatter are consistent with the prediction, at a false-alarm probability of"
            f" {settings.chance:.0%} over the whole study (exact binomial test, chi-squared test,"
            " Bonferroni). Where all offsets are identified the errors must scatter as predicted; where one"
            " is weakly observable the model is not linear along its direction, and they must scatter as the"
            " fits of the runs state. Degenerate cases are judged likewise, but do not count for the study:"
            " intervals from the curvature need not hold there",
            "Fits that did not converge, or contradict noise and priors (p-value below"
            f" {CONTRADICTED:g}) even from {MANY_STARTS} starts, are counted as failed and left out of the"
            " errors",
        ]
    if any(one.midpoint for one in parameters):
        sentences.append(
            "The midpoint fit uses neither spot readings nor priors and starts from zero offsets, as in the"
            " paper. Where it converges to another local optimum its error is large; the RMSE includes those"
            " runs"
        )
    return sentences


def _on_geometry(settings: GridSettings) -> list[str]:
    if settings.header().arm is None:
        return []
    return [
        "The links of every simulated arm deviate from nominal geometry by random draws from the tolerances,"
        " and so do gravity and harmonics unless they are false; the likelihood estimates them. The midpoint"
        " fit takes the geometry as nominal"
    ]


def _range(cases: Sequence[GridCase]) -> str:
    stds = [(case.worst_std, case.words) for case in cases if case.worst_std is not None]
    if not stds:
        return "In no case are all offsets identifiable."
    (low, best), (high, worst) = min(stds), max(stds)
    text = "The standard uncertainty of the least certain offset is"
    if best == worst:
        return f"{text} {spread(low, 'deg')} ({best})."
    least, most = f"{spread(low, 'deg')} ({best})", f"{spread(high, 'deg')} ({worst})"
    return f"{text} smallest at {least} and largest at {most}."


def _by_word(i: int, axis: GridAxis, cases: Sequence[GridCase]) -> str:
    """The range of the worst std at each value of an axis of words."""
    parts = []
    for j, value in enumerate(axis.values):
        stds = [case.worst_std for case in cases if case.at[i] == j and case.worst_std is not None]
        low, high = (spread(pick(stds)) for pick in (min, max)) if stds else ("", "")
        text = (
            "never all offsets identifiable"
            if not stds
            else f"{low}°"
            if low == high
            else f"{low} to {high}°"
        )
        parts.append(f"{value} {text}")
    some = any(case.worst_std is not None for case in cases)
    text = f"Standard uncertainty of the least certain offset by {axis.label}: {'; '.join(parts)}"
    return text if some and len(parts) > 1 else ""


def _trend(i: int, axis: GridAxis, values: Sequence[float], cases: Sequence[GridCase]) -> str:
    """By what factor the worst std changes from the lowest to the highest value of an axis of numbers."""
    rows: dict[tuple[int, ...], dict[int, float]] = {}
    for case in cases:
        if case.worst_std is not None:
            rows.setdefault(case.at[:i] + case.at[i + 1 :], {})[case.at[i]] = case.worst_std
    ends = {
        others: (min(row, key=values.__getitem__), max(row, key=values.__getitem__))
        for others, row in rows.items()
        if len(row) > 1
    }
    if not ends:
        return ""
    (first, last), _ = Counter(ends.values()).most_common(1)[0]
    factors = [
        rows[others][last] / rows[others][first] for others, pair in ends.items() if pair == (first, last)
    ]
    return (
        f"With {axis.label} from {exact(values[first])} to {exact(values[last], axis.unit)} the standard"
        " uncertainty of the least certain offset changes by a factor of"
        f" {_quantiles(factors, 'the other settings')}"
    )


def _midpoint(cases: Sequence[GridCase]) -> str:
    ratios = [
        one.midpoint.rmse / one.likelihood.rmse
        for case in cases
        for one in case.parameters
        if one.midpoint is not None and one.likelihood is not None
    ]
    if not ratios:
        return ""
    factor = _quantiles(ratios, "cases and parameters")
    return f"The RMSE of the midpoint fit is that of the likelihood fit times {factor}"


def _quantiles(values: Sequence[float], over: str) -> str:
    low, middle, high = (significant(float(np.quantile(values, q)), 2) for q in (0, 0.5, 1))
    return middle if low == high else f"{middle} (median; {low} to {high} over {over})"


def _counted(
    axes: Sequence[GridAxis], cases: Sequence[GridCase], those: Sequence[GridCase], what: str
) -> str:
    """'4 of 8 cases are …, including all with …': the values of axes at which every case is one of those."""
    if not those:
        return ""
    names = []
    for i, axis in enumerate(axes):
        for j, value in enumerate(axis.values):
            count = sum(case.at[i] == j for case in cases)
            if len(those) < len(cases) and 1 < count == sum(case.at[i] == j for case in those):
                names.append(value if isinstance(value, str) else f"{axis.label} {exact(value, axis.unit)}")
    including = f" (including all with {listed(names)})" if names else ""
    is_are = "is" if len(those) == 1 else "are"
    return f"{len(those)} of {len(cases)} cases{including} {is_are} {what}."


def _agreement(cases: Sequence[GridCase]) -> list[str]:
    judged = [case for case in cases if case.agrees is not None]
    counting = [case for case in judged if case.verdict != "degenerate"]
    degenerate = [case for case in judged if case.verdict == "degenerate"]
    parts = []
    for those, which in ((counting, "cases"), (degenerate, "degenerate cases")):
        off = [case.words for case in those if not case.agrees]
        if off:
            named = f"{len(off)} of {len(those)} {which}: {listed(off, _MOST_NAMED)}"
            parts.append(f"The simulated runs contradict the prediction in {named}.")
            if those is counting and all(case.agrees or case.as_stated for case in those):
                parts.append(
                    "There the errors are as the fits of the runs state: the prediction is for the nominal"
                    " arm, and these arms are far from it."
                )
        elif those and those is counting:
            which = " that are not degenerate" if degenerate else ""
            parts.append(f"The simulated runs agree with the prediction in all {len(those)} cases{which}.")
    failed = sum(case.failed for case in cases)
    return [*parts, f"Failed fits: {failed}."] if judged and failed else parts
