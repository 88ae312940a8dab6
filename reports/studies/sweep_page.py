"""The page of a study over settings: predictions and observed errors of every case of a grid.

One page serves them all, people's own included: what is shown follows from the axes, not from the name.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator

from ...analysis.status import Verdict as CaseVerdict
from ...experiments.studies.sweeps.grid_answer import (
    CaseParameter,
    GridCase,
    GridStudy,
    LikelihoodErrors,
    RunErrors,
)
from ...model.instruments.registry import kinds_of
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, sentence, shown
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    LegendEntry,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from . import study_blocks as blocks
from .sweep_figures import STANDING, case_name, figure_names, is_varied, shown_unit, tolerance, value_text

MOST_ROWS = 60
_MOST_BEST = 20  # cases of a table that cannot have them all
_LONGEST_TEXT = 400
_MOST_REASONS, _MOST_NAMED = 8, 4


def sweep_page(study: GridStudy) -> Page:
    """The display strings of a study over settings."""
    over = listed([clipped(axis.label) for axis in study.axes])
    settings = study.settings.as_in_file()
    facts = [(clipped(name, blocks.LONGEST_NAME), text) for name, text in _settings(study, settings)]
    facts.append(("Seed", str(study.settings.seed)))
    sections = [
        section_of(
            f"Cases by {over}",
            *map(FigureBlock, figure_names(study)),
            _over_cases(study),
            _beside(study),
            _summary(study),
            Legend(_meanings(study), _without_plan(study)),
        ),
        section_of("Each parameter", Paragraph(_how_to_read(study)), _parameters(study)),
    ]
    return blocks.view_of(
        study,
        f"{counted(len(study.cases), 'case')} by {over}",
        sections,
        "cases.csv and offsets.csv hold every case and every parameter of it",
        simulated=study.settings.runs > 0,
        by_the_paper=any(kind.beam for kind in kinds_of(settings).values()),
        details=_words(study),
        settings=facts,
    )


# ── tables ────────────────────────────────────────────────────────────────────────────────────


def _summary(study: GridStudy) -> Table:
    shots = {case.shots for case in study.cases if case.shots is not None}
    # Columns that are there only where they say something.
    counts = len(shots) > 1 and not is_varied(study, "plan.shots")
    simulated, failed = study.has("likelihood"), any(case.failed for case in study.cases)
    columns = [
        *(clipped(axis.label) for axis in study.axes),
        "verdict",
        *(["measurements"] if counts else []),
        "least certain offset, u",
        *(["runs agree"] if simulated else []),
        *(["failed fits"] if failed else []),
    ]
    rows = []
    best = sorted(study.cases, key=_rank)[:_MOST_BEST]
    listed_cases = study.cases if len(study.cases) <= MOST_ROWS else best
    for case in listed_cases:
        mark, words = STANDING[case.verdict]
        cells: list[str | Cell] = [value_text(axis, i) for axis, i in zip(study.axes, case.at, strict=True)]
        cells += [Cell(words, mark=mark)]
        cells += [str(case.shots or "")] if counts else []
        cells += [_least_certain(case)]
        cells += [_agreement(case)] if simulated else []
        cells += [str(case.failed)] if failed else []
        rows.append(row_of(*cells))
    plans = f"plan of {counted(shots.pop(), 'measurement')}" if len(shots) == 1 else "plan"
    caption = f"Verdict of each {plans}, and predicted standard uncertainty u of its least certain offset"
    caption += "; whether simulated runs agree with the prediction" if simulated else ""
    if len(listed_cases) < len(study.cases):
        caption += f" (the {len(listed_cases)} best of {len(study.cases)} cases shown, all in cases.csv)"
    sides = "".join("r" if i and axis.numeric else "l" for i, axis in enumerate(study.axes))
    aligned = f"{sides}l{'r' if counts else ''}r{'l' if simulated else ''}r"
    return table_of(caption, columns, rows, aligned)


def _rank(case: GridCase) -> float:
    return math.inf if case.worst_std is None else case.worst_std


def _over_cases(study: GridStudy) -> Table | None:
    """Each offset over the cases, where they are more than a table of them can show."""
    if len(study.cases) <= MOST_ROWS:
        return None
    columns = ["offset", "smallest u", "median", "largest", "not determined"]
    rows = []
    for one in study.over_cases():
        unit = clipped(one.unit, blocks.LONGEST_NAME)
        figures = (one.least, one.median, one.largest)
        cells = [blocks.NOT_DETERMINED if std is None else numbers.spread(std, unit) for std in figures]
        rows.append(row_of(label(one.name, 12), *cells, f"in {one.without} of {one.cases}"))
    caption = (
        "Predicted standard uncertainty u of each offset over the cases that have a plan; not determined"
        " counts as larger than any u"
    )
    return table_of(caption, columns, rows, "lrrrl") if rows else None


def _beside(study: GridStudy) -> Table | None:
    """The cases beside the grid: u of each offset."""
    if not study.beside:
        return None
    names = dict.fromkeys(
        one.name
        for case in study.beside
        for one in case.parameters
        if one.group == "offset" and one.status != "held"
    )
    columns = ["case", "verdict", *(label(name, 12) for name in names)]
    rows = []
    for case in study.beside:
        mark, words = STANDING[case.verdict]
        stds = {one.name: _predicted(one) if one.has_numbers else _unknown(one) for one in case.parameters}
        cells = [stds.get(name, "") for name in names]
        rows.append(row_of(clipped(case.words, _LONGEST_TEXT), Cell(words, mark=mark), *cells))
    return table_of("Beside the grid: predicted standard uncertainty u of each offset", columns, rows, "llr")


def _least_certain(case: GridCase) -> str:
    if case.reason is not None:
        return ""
    if (one := case.worst) is not None:
        return f"{label(one.name, 12)}: {_predicted(one)}{', assumed' * (one.status == 'assumed')}"
    names = [label(one.name, 12) for one in case.unidentifiable if one.group == "offset"]
    # Short enough for a column of the terminal.
    which = listed(names) if 0 < len(names) < 3 else counted(len(names), "offset")
    return f"{which}: {blocks.NOT_DETERMINED}" if names else blocks.NOT_DETERMINED


def _agreement(case: GridCase) -> Cell:
    """Whether the simulated runs agree with the prediction of every parameter."""
    if case.agrees is None:
        return Cell("" if case.reason is not None else "none")
    return Cell("yes", mark="identified") if case.agrees else Cell("no", mark="weak")


def _parameters(study: GridStudy) -> Table | None:
    """Predictions and observed errors by case; None where no case has a plan."""
    likelihood, midpoint = study.has("likelihood"), study.has("midpoint")
    columns = ["parameter", "status", "predicted u"]
    if likelihood:
        within = f"within {blocks.percent(study.settings.level)}"
        columns += ["RMSE", "bias", within]
    if midpoint:
        columns.append("midpoint RMSE")
    span = len(columns) - 1
    cases = [(i, case) for i, case in enumerate(study.cases, start=1) if case.reason is None]
    if len(study.cases) > MOST_ROWS:
        cases.sort(key=lambda numbered: _rank(numbered[1]))
    rows: list[Row] = []
    count = 0
    for number, case in cases:
        mark, words = STANDING[case.verdict]
        about = f"{case_name(study, case)}: {words}, {counted(case.shots or 0, 'measurement')}"
        of_case = [row_of(f"case {number}", Cell(about, span=span), tone=mark)]
        for one in case.parameters:
            cells = _cells(one, likelihood, midpoint) if one.has_numbers else [Cell(_unknown(one), span=span)]
            of_case.append(row_of(label(one.name), *cells, tone="" if one.has_numbers else one.status))
        if count and len(rows) + len(of_case) > MOST_ROWS:
            break
        rows += of_case
        count += 1
    caption = "Predicted standard uncertainty u of each parameter"
    caption += ", and errors of simulated runs" if likelihood else ""
    aligned = "llrrrlr" if likelihood else "llr"
    return table_of(_cut(caption, count, len(cases), "offsets.csv"), columns, rows, aligned) if rows else None


def _unknown(one: CaseParameter) -> str:
    return blocks.NOT_DETERMINED if one.status == "unidentifiable" else "held"


def _cells(one: CaseParameter, likelihood: bool, midpoint: bool) -> list[str | Cell]:
    """The cells of a parameter that is identified, behind its name."""
    unit = shown_unit(one)
    cells: list[str | Cell] = [Cell(one.status, mark=one.status), _predicted(one, one.likelihood)]
    if one.likelihood is not None:
        bias = numbers.estimate(one.likelihood.bias, one.likelihood.bias_std, unit)
        cells += [_rmse(one.likelihood, unit), bias, _held(one.likelihood)]
    elif likelihood:
        cells += [blocks.NOT_GIVEN] * 3
    if midpoint:
        cells.append(blocks.NOT_GIVEN if one.midpoint is None else _rmse(one.midpoint, unit))
    return cells


def _predicted(one: CaseParameter, beside: RunErrors | None = None) -> str:
    """A prediction: two digits, or as many as the RMSE of the runs next to it."""
    if one.std is None:
        return blocks.NOT_GIVEN
    about = one.std if beside is None else _about(beside)
    return numbers.estimate(one.std, about, shown_unit(one))


def _rmse(errors: RunErrors, unit: str) -> str:
    return numbers.estimate(errors.rmse, _about(errors), unit)


def _about(errors: RunErrors) -> float:
    """The standard error of an RMSE of n runs: the relative one is 1/√(2n)."""
    return errors.rmse / math.sqrt(2 * errors.runs)


def _held(errors: LikelihoodErrors) -> Cell:
    text = blocks.share_text(errors.held, errors.held_low, errors.held_high, errors.runs)
    return Cell(text, mark="identified" if errors.agrees else "weak")


def _cut(caption: str, count: int, total: int, file: str) -> str:
    """A caption that says how many of the cases are shown."""
    return caption if count == total else f"{caption} ({count} of {total} cases shown, all in {file})"


# ── words ─────────────────────────────────────────────────────────────────────────────────────


def _how_to_read(study: GridStudy) -> str:
    meaning = "The predicted standard uncertainty u is that of the fit of one run, priors included."
    if not study.has("likelihood"):
        return f"{meaning} No runs were simulated."
    unmet = sum(case.unmet for case in study.cases)
    more = f" {counted(unmet, 'more arm')} that cannot hit the target had been drawn." if unmet else ""
    return (
        f"{meaning} RMSE and bias are those of fits to simulated runs. The share is that of"
        f" their {blocks.percent(study.settings.level)} intervals that contain the true value, with its 95 %"
        f" binomial interval; a diamond marks a share or a scatter that contradicts the prediction."
        f" {blocks.BY_CHANCE}{more}"
    )


def _meanings(study: GridStudy) -> list[LegendEntry]:
    limits = {tolerance(study, one) for one in study.parameters if one.is_angular_offset}
    at = limits.pop() if len(limits) == 1 else None
    limit = f"the tolerance of {numbers.exact(at, 'deg')}" if at is not None else "its tolerance"
    assumed = any(one.status == "assumed" for one in study.parameters)
    but = "; what is assumed is no part of it" if assumed else ""
    every = "; or all that is estimated is as good as what is assumed of the tool" if assumed else ""
    texts: dict[CaseVerdict | None, str] = {
        "pass": f"every offset has a predicted u within {limit}{but}",
        "weak": "every offset is identifiable, but one or more only weakly observable: u exceeds"
        f" {limit}{every}",
        "degenerate": "one or more offsets are unidentifiable",
        None: "no such plan exists, for the reason below",
    }
    present = {case.verdict for case in study.cases}
    return [LegendEntry(*STANDING[key], text) for key, text in texts.items() if key in present]


def _without_plan(study: GridStudy) -> list[LegendEntry]:
    """Each reason why there is no plan, with its cases."""
    by_reason: dict[str, list[str]] = {}
    for case in study.cases:
        if case.reason is not None:
            by_reason.setdefault(sentence(case.reason).rstrip("."), []).append(case_name(study, case))
    if len(by_reason) > _MOST_REASONS:  # what they have in common, without what each found
        heads: dict[str, list[str]] = {}
        for reason, names in by_reason.items():
            heads.setdefault(reason.rpartition(": ")[0] or reason, []).extend(names)
        by_reason = heads
    shown = []
    for reason, names in list(by_reason.items())[:_MOST_REASONS]:
        more = f"; and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
        shown.append(
            LegendEntry("held", f"No plan for {'; '.join(names[:_MOST_NAMED])}{more}:", f"{reason}.")
        )
    if len(by_reason) > len(shown):
        text = f"{len(shown)} of {len(by_reason)} shown, all in cases.csv."
        shown.append(LegendEntry("held", "Reasons:", text))
    return shown


def _settings(study: GridStudy, value: object, path: str = "") -> Iterator[tuple[str, str]]:
    """Settings as rows, `tolerance.offset_deg` and 0.1: nested ones one by one."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _settings(study, item, f"{path}.{key}" if path else str(key))
        return
    flat = isinstance(value, list) and not any(isinstance(item, dict | list) for item in value)
    text = ", ".join(map(_plain, value)) if isinstance(value, list) and flat else _plain(value)
    yield path, "changes from case to case" if is_varied(study, path) else clipped(text, _LONGEST_TEXT)


def _plain(value: object) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, int | float):
        return numbers.exact(value)
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _words(study: GridStudy) -> list[Section]:
    """The cases in words, where they say more than the axes do: not on a grid of numbers."""
    if len(study.cases) > MOST_ROWS or all(axis.numeric for axis in study.axes):
        return []
    rows = [(case_name(study, case), sentence(case.words)) for case in study.cases]
    return [section_of("Cases", Facts(rows), level=2)]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────

_RUN_ERRORS = ("runs", "rmse", "bias", "bias_std")


def case_rows(study: GridStudy) -> Iterator[blocks.PlainRow]:
    """One row for each case; no number where it does not identify all offsets."""
    for number, case in enumerate((*study.cases, *study.beside), start=1):
        yield {
            **_case_columns(study, number, case),
            **blocks.columns_of(case, "words", "verdict", "reason", "shots", "failed", "unmet"),
            "worst_offset": case.worst.name if case.worst is not None else None,
            "worst_std": case.worst_std,
            "not_determined": " ".join(one.name for one in case.unidentifiable),
        }


def parameter_rows(study: GridStudy) -> Iterator[blocks.PlainRow]:
    """One row for each case and parameter; nothing but names where the case does not identify it."""
    for number, case in enumerate((*study.cases, *study.beside), start=1):
        for one in case.parameters:
            yield {
                **_case_columns(study, number, case),
                "parameter": one.name,
                **blocks.columns_of(one, "unit", "status", "std"),
                **blocks.columns_of(
                    one.likelihood,
                    *_RUN_ERRORS,
                    *("held", "held_low", "held_high", "agrees"),
                    prefix="likelihood_",
                ),
                **blocks.columns_of(one.midpoint, *_RUN_ERRORS, prefix="midpoint_"),
            }


def _case_columns(study: GridStudy, number: int, case: GridCase) -> blocks.PlainRow:
    """Columns that say which case it is; axes are numbered, so that no key hides another column."""
    at = case.at or (None,) * len(study.axes)  # beside the grid
    named = enumerate(zip(study.axes, at, strict=True), start=1)
    return {
        "case": number,
        **{f"axis{k}_{shown(axis.key)}": None if i is None else axis.values[i] for k, (axis, i) in named},
    }
