"""The page of the study `coverage`: do the intervals of each estimator hold the truth as often as stated?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...experiments.studies.coverage import (
    CoveragePlan,
    CoverageSettings,
    CoverageStudy,
    CoveredParameter,
    RankCalibration,
    RankedParameter,
)
from ...words import numbers
from ...words.wording import clipped, counted, listed, sentence
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture
from .coverage_figures import coverage_picture, ranks_picture, rmse_ratio_picture, rmse_ratios
from .study_blocks import (
    BY_CHANCE,
    ERROR_COLUMNS,
    LONGEST_NAME,
    NOT_DETERMINED,
    PlainRow,
    error_cells,
    how_it_was_done,
    meanings,
    noise_in_words,
    percent,
    plan_title,
    rows_of,
    share_cell,
    share_columns,
    standing_cell,
    undetermined,
    unmet_in_words,
    verdicts,
    view_of,
    worst_cell,
)


def coverage_page(answer: CoverageStudy) -> Page:
    """The display strings of a coverage study."""
    settings, plans = answer.settings, answer.plans
    estimators = [estimator for plan in plans for estimator in plan.estimators]
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings.levels),
            Legend(meanings(estimators, [part for plan in plans for part in plan.sbc]), []),
            Paragraph(BY_CHANCE),
            brief=True,
        ),
        how_it_was_done(
            answer,
            [
                ("Data sets for each plan", str(settings.data_sets)),
                ("Seed", str(settings.seed)),
                ("Levels", ", ".join(percent(level) for level in settings.levels)),
                ("Draws behind each rank", str(settings.draws)),
                ("Bins of the rank histograms", str(settings.bins)),
                ("Posterior", sentence(settings.posterior)),
            ],
            "coverage.csv and ranks.csv hold the shares and the ranks",
        ),
        *(section for i, plan in enumerate(plans, start=1) for section in _plan(plan, i)),
    ]
    if text := comparison(plans):
        title = "The midpoint fit against the likelihood fit"
        sections.append(section_of(title, Paragraph(text), FigureBlock("accuracy"), brief=True))
    for number, plan in enumerate(plans, start=1):
        sections += _numbers(plan, settings, number)
    subtitle = f"{settings.data_sets} simulated data sets for each of {counted(len(plans), 'plan')}"
    return view_of(answer, f"{subtitle}, seed {settings.seed}", sections)


# ── all plans ─────────────────────────────────────────────────────────────────────────────────


OVERVIEW = "Share of intervals that hold the truth, in %: the parameter farthest from each level"


def _overview(plans: Sequence[CoveragePlan], levels: Sequence[float]) -> Table:
    # The verdict second, so that a phone shows it without scrolling.
    columns = ["estimator", "intervals", *map(percent, levels)]
    rows = []
    for plan in plans:
        rows.append(row_of(plan_title(plan.name), Cell(sentence(plan.words), span=len(columns) - 1)))
        for estimator in plan.estimators:
            cells = [worst_cell(estimator, level) for level in levels]
            name, verdict = clipped(estimator.name, LONGEST_NAME), standing_cell(estimator)
            rows.append(row_of(name, verdict, *cells, tone=verdict.mark))
    return table_of(OVERVIEW, columns, rows, "llr")


# ── one plan ──────────────────────────────────────────────────────────────────────────────────


def _plan(plan: CoveragePlan, number: int) -> list[Section]:
    facts = [
        ("Plan", sentence(plan.words)),
        ("Robot", clipped(plan.robot)),
        ("Measurements", str(plan.shots)),
        ("Noise", noise_in_words(plan.noise)),
        ("Data sets", str(plan.data_sets)),
        ("Targets not hit", unmet_in_words(plan.failed)),
    ]
    if without := undetermined(plan.estimators):
        facts.append((NOT_DETERMINED, listed(without)))
    # Facts, sentences and figure fit one page; what else there is of the plan comes at the end.
    return [
        section_of(plan_title(plan.name), Facts(facts), new_page=True, brief=True),
        section_of(
            "Coverage",
            Legend([], [*verdicts(plan.estimators), *verdicts(plan.sbc)]),
            FigureBlock(f"coverage_{number}"),
            level=2,
            brief=True,
        ),
    ]


def _numbers(plan: CoveragePlan, settings: CoverageSettings, number: int) -> list[Section]:
    """The tables of a plan, and its ranks."""
    powers, uniformity = _powers(plan.sbc), _ranks_table(plan.sbc, settings.bins)
    title = f"{plan_title(plan.name)}, numbers and ranks"
    tables = section_of(title, _coverage_table(plan, settings.levels), _accuracy_table(plan), new_page=True)
    return [
        replace(tables, folded=True),
        section_of(
            "Ranks of the truth among the draws",
            Paragraph(powers) if powers else None,
            FigureBlock(f"ranks_{number}"),
            uniformity,
            level=2,
        ),
    ]


def _powers(parts: Sequence[RankCalibration]) -> str:
    """The power of the tests for uniform ranks, once where it is the same for all."""
    powers: dict[str, list[str]] = {}
    for part in parts:
        if part.power:
            powers.setdefault(sentence(part.power).rstrip("."), []).append(clipped(part.name, LONGEST_NAME))
    if len(powers) == 1:
        return f"Power of the test: {next(iter(powers))}."
    return " ".join(f"Power of the test for {listed(names)}: {text}." for text, names in powers.items())


def _coverage_table(plan: CoveragePlan, levels: Sequence[float]) -> Table:
    def cells(row: CoveredParameter, control: bool) -> list[str | Cell] | None:
        entries = {entry.level: entry for entry in row.coverage}
        return [share_cell(entries.get(level), control) for level in levels] if entries else None

    rows = [row for part in plan.estimators for row in rows_of(part, part.words, len(levels), cells)]
    columns = ["parameter", *map(percent, levels)]
    return table_of(
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval", columns, rows
    )


def _accuracy_table(plan: CoveragePlan) -> Table:
    def cells(row: CoveredParameter, control: bool) -> list[str | Cell] | None:
        return error_cells(row, solved(plan))

    rows = [row for part in plan.estimators for row in rows_of(part, part.words, len(ERROR_COLUMNS), cells)]
    columns = ["parameter", *ERROR_COLUMNS]
    return table_of("Bias and root mean square error, next to what was predicted", columns, rows)


def solved(plan: CoveragePlan) -> int:
    """The number of data sets, on which bias and rmse rest."""
    return max(1, plan.data_sets)


def _ranks_table(parts: Sequence[RankCalibration], bins: int) -> Table | None:
    def cells(row: RankedParameter, control: bool) -> list[str | Cell] | None:
        if row.chi2 is None or row.p_value is None:
            return None
        return [numbers.significant(row.chi2), numbers.p_value(row.p_value)]

    rows = [row for part in parts for row in rows_of(part, "", 2, cells)]
    columns = ["parameter", f"χ² ({bins - 1} degrees of freedom)", "p-value"]
    return table_of("Are the ranks uniform?", columns, rows) if rows else None


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


def comparison(plans: Sequence[CoveragePlan]) -> str:
    """How much worse the midpoint fit is, in a sentence; empty where no plan has both fits."""
    parts = []
    for plan in plans:
        if not (ratios := rmse_ratios(plan)):
            continue
        low, high = (choose(ratios, key=lambda one: one.ratio) for choose in (min, max))
        between = numbers.interval((low.ratio, high.ratio), high.std)
        parts.append(f"{between} times for the plan {clipped(plan.name, LONGEST_NAME)}")
    if not parts:
        return ""
    return (
        "The rmse of the midpoint fit (eq. 8) as a multiple of the likelihood fit’s, from the"
        f" same data: {'; '.join(parts)}. Above 1 the midpoint fit is the worse."
    )


def coverage_pictures(answer: CoverageStudy) -> list[Picture | None]:
    """Two for each plan, and one for all."""
    drawn: list[Picture | None] = []
    for number, plan in enumerate(answer.plans, start=1):
        # Numbered, since a plan's name may be anything.
        drawn.append(
            coverage_picture(
                plan.estimators,
                answer.settings.levels,
                solved(plan),
                f"coverage_{number}",
                f"Plan {clipped(plan.name, 40)}: how",
            )
        )
        drawn.append(ranks_picture(plan, answer.settings, f"ranks_{number}"))
    return [*drawn, rmse_ratio_picture([(plan.name, rmse_ratios(plan)) for plan in answer.plans])]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def coverage_rows(answer: CoverageStudy) -> Iterator[PlainRow]:
    """One row for each plan, estimator, parameter and level."""
    for plan in answer.plans:
        for estimator in plan.estimators:
            for parameter in estimator.parameters:
                entries = {entry.level: entry for entry in parameter.coverage}
                for level in answer.settings.levels:
                    yield {
                        "plan": plan.name,
                        "estimator": estimator.name,
                        "control": estimator.control,
                        "parameter": parameter.name,
                        "status": parameter.status,
                        "level": level,
                        **share_columns(entries.get(level)),
                    }


def rank_rows(answer: CoverageStudy) -> Iterator[PlainRow]:
    """One row for each plan, sampler, parameter and bin."""
    for plan in answer.plans:
        for part in plan.sbc:
            for parameter in part.parameters:
                for number, count in enumerate(parameter.ranks):
                    yield {
                        "plan": plan.name,
                        "estimator": part.name,
                        "control": part.control,
                        "parameter": parameter.name,
                        "bin": number,
                        "count": count,
                    }
