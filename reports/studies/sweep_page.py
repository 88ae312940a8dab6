"""The page of a study over settings: predictions and observed errors of every case of a grid.

One page serves them all, people's own included: what is shown follows from the axes, not from the name.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from typing import Any

from ...analysis.status import Verdict as CaseVerdict
from ...experiments.studies.sweeps.grid_answer import (
    CaseParameter,
    GridCase,
    GridStudy,
    LikelihoodErrors,
    OffsetOverCases,
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
    Paragraph,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from . import study_blocks as blocks
from .sweep_figures import (
    STANDING,
    case_name,
    figure_names,
    is_varied,
    shown_unit,
    sweep_pictures,
    tolerance,
    value_text,
)

MOST_ROWS = 60
_MOST_BEST = 20  # cases of a table that cannot have them all
_LONGEST_TEXT = 400
_MOST_REASONS, _MOST_NAMED = 8, 4


def _over(study: GridStudy) -> str:
    return listed([clipped(axis.label) for axis in study.axes])


def _sections(study: GridStudy) -> list[Section]:
    return [
        section_of(
            f"Cases by {_over(study)}",
            *map(FigureBlock, figure_names(study)),
            _over_cases(study),
            _beside(study),
            _summary(study),
            Legend(_meanings(study), _without_plan(study)),
        ),
        section_of("Each parameter", Paragraph(_how_to_read(study)), _parameters(study)),
    ]


# ── tables ────────────────────────────────────────────────────────────────────────────────────


def _verdict(case: GridCase) -> Cell:
    mark, words = STANDING[case.verdict]
    return Cell(words, mark=mark)


def _summary(study: GridStudy) -> Table:
    shots = {case.shots for case in study.cases if case.shots is not None}

    def at(i: int) -> Callable[[GridCase], str]:
        return lambda case: value_text(study.axes[i], case.at[i])

    # Head, cell and side of each column; some are there only where they say something.
    columns: list[tuple[str, Callable[[GridCase], str | Cell], str]] = [
        (clipped(axis.label), at(i), "r" if i and axis.numeric else "l") for i, axis in enumerate(study.axes)
    ]
    columns.append(("verdict", _verdict, "l"))
    if len(shots) > 1 and not is_varied(study, "plan.shots"):
        columns.append(("measurements", lambda case: str(case.shots or ""), "r"))
    columns.append(("least certain offset, u", _least_certain, "r"))
    plans = f"plan of {counted(shots.pop(), 'measurement')}" if len(shots) == 1 else "plan"
    caption = f"Verdict of each {plans}, and predicted standard uncertainty u of its least certain offset"
    if study.has("likelihood"):
        columns.append(("runs agree", _agreement, "l"))
        caption += "; whether simulated runs agree with the prediction"
    if any(case.failed for case in study.cases):
        columns.append(("failed fits", lambda case: str(case.failed), "r"))
    cases = study.cases
    if len(cases) > MOST_ROWS:
        cases = tuple(sorted(cases, key=_rank)[:_MOST_BEST])
        caption += f" (the {len(cases)} best of {len(study.cases)} cases shown, all in cases.csv)"
    heads, of, sides = zip(*columns, strict=True)
    return blocks.table(caption, heads, cases, lambda case: [cell(case) for cell in of], "".join(sides))


def _rank(case: GridCase) -> float:
    return math.inf if case.worst_std is None else case.worst_std


def _over_cases(study: GridStudy) -> Table | None:
    """Each offset over the cases, where they are more than a table of them can show."""

    def cells(one: OffsetOverCases) -> blocks.Cells:
        unit = clipped(one.unit, blocks.LONGEST_NAME)
        stds = (one.least, one.median, one.largest)
        known = [blocks.NOT_DETERMINED if std is None else numbers.spread(std, unit) for std in stds]
        return [label(one.name, 12), *known, f"in {one.without} of {one.cases}"]

    caption = (
        "Predicted standard uncertainty u of each offset over the cases that have a plan; not determined"
        " counts as larger than any u"
    )
    heads, offsets = ["offset", "smallest u", "median", "largest", "not determined"], study.over_cases()
    many = len(study.cases) > MOST_ROWS and offsets
    return blocks.table(caption, heads, offsets, cells, "lrrrl") if many else None


def _beside(study: GridStudy) -> Table | None:
    """The cases beside the grid: u of each offset."""
    offsets = [one for case in study.beside for one in case.parameters if one.group == "offset"]
    names = dict.fromkeys(one.name for one in offsets if one.status != "held")

    def cells(case: GridCase) -> blocks.Cells:
        stds = {one.name: _predicted(one) if one.has_numbers else _unknown(one) for one in case.parameters}
        return [clipped(case.words, _LONGEST_TEXT), _verdict(case), *(stds.get(name, "") for name in names)]

    caption = "Beside the grid: predicted standard uncertainty u of each offset"
    heads = ["case", "verdict", *(label(name, 12) for name in names)]
    return blocks.table(caption, heads, study.beside, cells, "llr") if study.beside else None


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
        columns += ["RMSE", "bias", f"within {blocks.percent(study.settings.level)}"]
    columns += ["midpoint RMSE"] if midpoint else []
    span = len(columns) - 1
    cases = [(i, case) for i, case in enumerate(study.cases, start=1) if case.reason is None]
    if len(study.cases) > MOST_ROWS:
        cases.sort(key=lambda numbered: _rank(numbered[1]))
    rows, count = list[Row](), 0
    for number, case in cases:
        verdict = _verdict(case)
        about = f"{case_name(study, case)}: {verdict.text}, {counted(case.shots or 0, 'measurement')}"
        of_case = [row_of(f"case {number}", Cell(about, span=span), tone=verdict.mark)]
        for one in case.parameters:
            cells = _cells(one, likelihood, midpoint) if one.has_numbers else [Cell(_unknown(one), span=span)]
            of_case.append(row_of(label(one.name), *cells, tone="" if one.has_numbers else one.status))
        if count and len(rows) + len(of_case) > MOST_ROWS:
            break
        rows += of_case
        count += 1
    caption = "Predicted standard uncertainty u of each parameter"
    caption += ", and errors of simulated runs" if likelihood else ""
    if count < len(cases):
        caption += f" ({count} of {len(cases)} cases shown, all in offsets.csv)"
    return table_of(caption, columns, rows, "llrrrlr" if likelihood else "llr") if rows else None


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


def _settings_facts(study: GridStudy) -> list[tuple[str, str]]:
    settings = _settings(study, study.settings.as_in_file())
    facts = [(clipped(name, blocks.LONGEST_NAME), text) for name, text in settings]
    return [*facts, ("Seed", str(study.settings.seed))]


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


def _of_cases(study: Any) -> Iterator[tuple[int, GridCase]]:
    return enumerate((*study.cases, *study.beside), start=1)


def _axes(study: Any, of: tuple[Any, ...]) -> blocks.PlainRow:
    """Which case it is; axes are numbered, so that no key hides another column."""
    number, case, *_ = of
    at = case.at or (None,) * len(study.axes)  # beside the grid
    values = {
        f"axis{k}_{shown(axis.key)}": None if i is None else axis.values[i]
        for k, (axis, i) in enumerate(zip(study.axes, at, strict=True), start=1)
    }
    return {"case": number, **values}


_FIT_COLUMNS = {
    "likelihood": "runs rmse bias bias_std held held_low held_high agrees",
    "midpoint": "runs rmse bias bias_std",
}
SWEEP = blocks.Study[GridStudy](
    subtitle=lambda study: f"{counted(len(study.cases), 'case')} by {_over(study)}",
    sections=_sections,
    drawn=sweep_pictures,
    details=_words,
    settings=_settings_facts,
    hold="cases.csv and offsets.csv hold every case and every parameter of it",
    tables={
        "cases.csv": blocks.flat(
            "",
            "1.1: words verdict reason shots failed unmet worst_offset=1.1.worst.name worst_std"
            " not_determined",
            _of_cases,
            _axes,
        ),
        "offsets.csv": blocks.flat(
            "",
            "parameter=1.2.name 1.2: unit status std"
            + "".join(
                f" {fit}_{name}=1.2.{fit}.{name}"
                for fit, names in _FIT_COLUMNS.items()
                for name in names.split()
            ),
            lambda study: (
                (number, case, one) for number, case in _of_cases(study) for one in case.parameters
            ),
            _axes,
        ),
    },
    simulated=lambda study: study.settings.runs > 0,
    by_the_paper=lambda study: any(kind.beam for kind in kinds_of(study.settings.as_in_file()).values()),
)
