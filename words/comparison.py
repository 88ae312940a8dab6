"""A comparison of repeated runs in sentences: its headline, its notes, what was found of each run."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..analysis.answer.findings import FileWarning, OtherBasins
from ..analysis.repeatability.compare import Comparison
from ..analysis.repeatability.consistency import LEVEL, of_a_std
from ..analysis.repeatability.repeats import (
    AssumedInRun,
    PriorInEstimate,
    RunFinding,
    SharedDistances,
    SharedTolerances,
    StatedMisfit,
)
from .misfit_words import criterion_sentence
from .numbers import p_words, times
from .observability import reason
from .wording import WEAK, be, capital, label, listed


def headline(runs: Comparison) -> str:
    """The answer in a sentence or two; first of all, which runs the model does not describe."""
    if not runs.misfits:
        return _headline(runs)
    one = len(runs.misfits) == 1
    return (
        f"The model does not describe {listed(runs.misfits)}: {'its' if one else 'their'} offsets, and every"
        f" mean that includes them, are unvalidated. {_headline(runs)}"
    )


def _headline(comparison: Comparison) -> str:
    if comparison.used < 2 or not any(row.runs for row in comparison.offsets):
        return "No offset is identifiable in two runs: nothing is compared."
    if comparison.consistency is None and not any(row.test for row in comparison.offsets):
        return (
            f"The {comparison.used} runs give a scatter, but whether they agree cannot be tested: there is no"
            " predicted uncertainty that the scatter could be compared with."
        )
    parts = []
    whole = comparison.consistency
    if whole is not None:
        parts.append(
            f"the {comparison.used} runs scatter {times(whole.ratio)} times as much as predicted"
            f" ({p_words(whole.p_value)})"
        )
    elif comparison.verdict in ("agrees", "misfit"):
        parts.append(f"each offset of the {comparison.used} runs scatters as predicted")
    if comparison.odd_run is not None:
        others = ", the others agree without it" if whole is not None else ""
        parts.append(f"{comparison.odd_run} is the outlier{others}")
    for names, verb, how in (
        (comparison.differing, "scatter", " more than predicted"),
        (comparison.drifting, "drift", ""),
    ):
        if names:
            parts.append(f"{listed(list(names))} {verb}{'s' if len(names) == 1 else ''}{how}")
    if not parts:
        parts.append("one run is an outlier, but the data do not determine which")
    whole_text = "; ".join(parts)
    return f"{whole_text[0].upper()}{whole_text[1:]}."


def failure(reason: str) -> str:
    """Why a run has no numbers."""
    return f"the fit did not converge: {reason}"


def notes(compared: Comparison) -> Iterator[str]:
    """What must be read with the answer."""
    for run in compared.runs:
        if run.reason is not None:
            yield f"{run.name} is not compared: {failure(run.reason)}"
        if run.undetermined:
            yield (
                f"{listed(run.undetermined)} of {run.name} {be(run.undetermined)} unidentifiable: then the"
                " predicted uncertainties of its other offsets are not reliable either, and the runs are"
                " compared by their scatter alone. Leave it out to test the others"
            )
    yield from _of_runs(compared)
    if apart := [row.name for row in compared.offsets if not row.runs]:
        yield f"Not compared: {listed(apart)}. An offset must be identifiable in two runs"
    if weak := sorted(
        {offset.name for run in compared.runs for offset in run.offsets if offset.status == "weak"}
    ):
        yield (
            f"{capital(WEAK)} in at least one run: {listed(weak)}. The part of the prior in an estimate is"
            " taken out, to first order"
        )
    if compared.consistency is not None and compared.consistency.ratio_interval95[1] < 1:
        yield (
            f"The runs scatter less than predicted ({times(compared.consistency.ratio)} times): the noise may"
            " be overstated, or part of it is the same in all runs"
        )
    yield from _hint_of_a_drift(compared)
    if compared.kind == "table":
        yield from _on_a_table(compared)
    if compared.kind == "results":
        yield (
            "Result files hold no covariance between offsets: each offset is tested on its own, and the"
            " p-values are adjusted for their number (Holm). Run files are tested as a whole"
        )
        if any(isinstance(offset, SharedTolerances) for run in compared.runs for offset in run.findings):
            yield (
                "Of a run with geometry: a result file has only the share of each variance that the"
                " tolerances set. What the arm's deviations add to an offset is taken as the same in all"
                " results, as with the same postures. With other postures offsets scatter more than predicted"
                " here, so that a disagreement may be due to the geometry: compare the run files"
            )
    if compared.noise_estimated:
        yield (
            "The noise is estimated: one factor on the stated noise is taken for all runs together, and the"
            " tests are F instead of chi-squared"
        )
    if compared.used == 2:
        yield "With two runs neither a drift nor an outlier can be tested: add a third run"
    yield (
        "Errors that are the same in all runs do not show in their scatter: geometry that deviates from"
        " nominal, backlash that is always taken up from one side, an instrument that is not as stated"
    )


def _of_runs(compared: Comparison) -> Iterator[str]:
    """What was found of the runs: what is the same of several is said once."""
    runs_by_sentence: dict[str, list[str]] = {}
    for run in compared.runs:
        for finding in run.findings:
            runs_by_sentence.setdefault(sentence_of(finding), []).append(run.name)
    for sentence, names in runs_by_sentence.items():
        every = 1 < len(names) == len(compared.runs)
        yield f"{'All runs' if every else listed(names)}: {sentence}"


def sentence_of(finding: RunFinding) -> str:
    """What was found of a run, to follow its name and a colon."""
    match finding:
        case StatedMisfit(text):
            return text
        case OtherBasins():
            return "other offsets fit nearly as well"
        case SharedDistances():
            return (
                "distances or angles between targets are stated: where runs share one, its error is the same"
                " in all of them and they scatter less than predicted"
            )
        case SharedTolerances():
            return (
                "the geometry is estimated: what the arm's deviations add is the same in all runs; their"
                " scatter is tested without it, and more runs do not lower it in the mean"
            )
        case AssumedInRun(name, why):
            because = why if isinstance(why, str) else why and reason(why)
            sentence = f"{label(name)} is assumed{f', {because}' if because else ''}"
            return (
                f"{sentence}. What was assumed is the same in every run, as long as nothing was mounted anew:"
                " the scatter does not show it, and more runs do not make it better"
            )
        case PriorInEstimate(name):
            return (
                f"{name} is not compared: the prior has a part in its estimate, and a result file does not"
                " say how to take it out; give the run file"
            )
        case FileWarning(text):
            return text
        case _:
            return criterion_sentence(finding)


# Of a time from the first run to the last of up to so many hours: a unit, and its hours.
_UNTIL = ((72.0, "hour", 1.0), (24.0 * 180, "day", 24.0), (math.inf, "year", 24 * 365.25))


def time_unit(comparison: Comparison) -> tuple[str, float]:
    """What the places of the runs are said in, and how many of `at` that is: hours, days or years where they
    have times, else runs."""
    if not comparison.by_time:
        return "run", 1.0
    whole = comparison.runs[-1].at - comparison.runs[0].at
    return next((name, per) for most, name, per in _UNTIL if whole <= most)


def _hint_of_a_drift(comparison: Comparison) -> Iterator[str]:
    drifts = [(row.drift.p_value, row.name, row.unit, row.drift) for row in comparison.offsets if row.drift]
    drifts = [drift for drift in drifts if drift[-1].p_holm < 1 - LEVEL]
    if drifts and not comparison.drifting:
        time, per = time_unit(comparison)
        _, name, unit, drift = min(drifts, key=lambda drift: drift[0])
        yield (
            f"A possible drift, not significant: {name} changes by {drift.slope * per:.2g} {unit} a {time},"
            f" nearly in a line ({p_words(drift.p_holm, 2)}, Holm-adjusted)"
        )


def _on_a_table(comparison: Comparison) -> Iterator[str]:
    count = max(row.runs for row in comparison.offsets)
    if count >= 2:
        low, high = of_a_std(count - 1)
        yield (
            f"From {count} runs a standard deviation is known to between {times(low)} and {times(high)} times"
            " the one that they show (95 %)"
        )
    yield (
        "Which noise would explain this scatter depends on the postures, which a table does not give: compare"
        " run files, or see zerobeam study table2, which answers it for the paper's Table 2"
    )
