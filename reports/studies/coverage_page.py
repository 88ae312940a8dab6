"""The page of the study `coverage`: do the intervals of each estimator hold the truth as often as stated?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...experiments.studies.coverage import (
    CoveragePlan,
    CoverageSettings,
    CoverageStudy,
    Estimator,
)
from ...experiments.studies.ranks import Calibration
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, sentence
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture
from .coverage_figure import coverage_picture
from .phrases import (
    LONGEST_NAME,
    NOT_DETERMINED,
    about_study,
    files_block,
    noise_in_words,
    plan_title,
    view_of,
)
from .ranks_figure import ranks_picture
from .rmse_ratio_figure import rmse_ratio_picture, rmse_ratios
from .shares import (
    BY_CHANCE,
    ERROR_COLUMNS,
    PlainRow,
    error_cells,
    meanings,
    percent,
    share_cell,
    share_columns,
    standing,
    verdicts,
    worst_cell,
)


def coverage_page(answer: CoverageStudy) -> Page:
    """The display strings of a coverage study."""
    settings, plans = answer.settings, answer.plans
    estimators = [own for plan in plans for own in plan.estimators]
    said = comparison(plans)
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings.levels),
            Legend(meanings(estimators, [part for plan in plans for part in plan.sbc]), []),
            Paragraph(BY_CHANCE),
        ),
        section_of(
            "How it was done",
            _settings(answer),
            files_block("coverage.csv and ranks.csv hold the shares and the ranks"),
        ),
        *(section for i, plan in enumerate(plans, start=1) for section in _plan(plan, settings, i)),
    ]
    if said:
        title = "The midpoint fit against the likelihood fit"
        sections.append(section_of(title, Paragraph(said), FigureBlock("accuracy")))
    subtitle = f"{settings.data_sets} simulated data sets for each of {counted(len(plans), 'plan')}"
    return view_of(answer, f"{subtitle}, seed {settings.seed}", sections)


# ── all plans ─────────────────────────────────────────────────────────────────────────────────


def overview_caption() -> str:
    return "Share of intervals that hold the truth, in %: the parameter farthest from each level"


def _overview(plans: Sequence[CoveragePlan], levels: Sequence[float]) -> Table:
    # The verdict second, so that a phone shows it without scrolling.
    columns = [("estimator", "left"), ("intervals", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for plan in plans:
        rows.append(row_of(plan_title(plan.name), Cell(sentence(plan.words), span=len(columns) - 1)))
        for estimator in plan.estimators:
            mark, words = standing(estimator)
            cells = [worst_cell(estimator, level) for level in levels]
            name = clipped(estimator.name, LONGEST_NAME)
            rows.append(row_of(name, Cell(words, mark=mark), *cells, tone=mark))
    return table_of(overview_caption(), columns, rows)


def _settings(answer: CoverageStudy) -> Facts:
    settings = answer.settings
    return about_study(
        answer,
        [
            ("Data sets for each plan", str(settings.data_sets)),
            ("Seed", str(settings.seed)),
            ("Levels", ", ".join(percent(level) for level in settings.levels)),
            ("Draws behind each rank", str(settings.draws)),
            ("Bins of the rank histograms", str(settings.bins)),
            ("Posterior", sentence(settings.posterior)),
        ],
    )


# ── one plan ──────────────────────────────────────────────────────────────────────────────────


def _plan(plan: CoveragePlan, settings: CoverageSettings, number: int) -> list[Section]:
    facts = [
        ("Plan", sentence(plan.words)),
        ("Robot", clipped(plan.robot)),
        ("Measurements", str(plan.shots)),
        ("Noise", noise_in_words(plan.noise)),
        ("Data sets", str(plan.data_sets)),
        ("Targets not hit", f"{plan.failed} (others drawn in their place)" if plan.failed else "none"),
    ]
    powers, uniformity = _powers(plan.sbc), _ranks_table(plan.sbc, settings.bins)
    # The facts, the sentences and the first figure of a plan fit one page.
    return [
        section_of(plan_title(plan.name), Facts(facts), new_page=True),
        section_of(
            "Coverage",
            Legend([], verdicts(plan.estimators)),
            FigureBlock(f"coverage_{number}"),
            _coverage_table(plan, settings.levels),
            _accuracy_table(plan),
            level=2,
        ),
        section_of(
            "Ranks of the truth among the draws",
            Legend([], verdicts(plan.sbc)),
            Paragraph(powers) if powers else None,
            FigureBlock(f"ranks_{number}"),
            uniformity,
            level=2,
        ),
    ]


def _powers(parts: Sequence[Calibration]) -> str:
    """What the uniformity test could have found, said once where it is the same for all."""
    said: dict[str, list[str]] = {}
    for part in parts:
        if part.power:
            said.setdefault(sentence(part.power).rstrip("."), []).append(clipped(part.name, LONGEST_NAME))
    if len(said) == 1:
        return f"Power of the test: {next(iter(said))}."
    return " ".join(f"Power of the test for {listed(names)}: {text}." for text, names in said.items())


def _coverage_table(plan: CoveragePlan, levels: Sequence[float]) -> Table:
    columns = [("parameter", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for estimator in plan.estimators:
        rows.append(_group(estimator, len(levels)))
        for row in estimator.parameters:
            if not row.coverage:
                words = Cell(NOT_DETERMINED, span=len(levels))
                rows.append(row_of(label(row.name), words, tone="unidentifiable"))
                continue
            entries = {entry.level: entry for entry in row.coverage}
            cells = [share_cell(entries.get(level), estimator.control) for level in levels]
            tone = "weak" if any(cell.mark for cell in cells) else ""
            rows.append(row_of(label(row.name), *cells, tone=tone))
    return table_of(
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval", columns, rows
    )


def _group(part: Estimator | Calibration, span: int) -> Row:
    """The row that heads the parameters of an estimator, or of its ranks."""
    mark, words = standing(part)
    # A name next to its own mark and words; what it does is said by the words of the estimator.
    about = f"{sentence(part.words)} ({words})" if isinstance(part, Estimator) else words
    return row_of(clipped(part.name, LONGEST_NAME), Cell(about, span=span), tone=mark)


def _accuracy_table(plan: CoveragePlan) -> Table:
    rows = []
    for estimator in plan.estimators:
        rows.append(_group(estimator, len(ERROR_COLUMNS)))
        for row in estimator.parameters:
            cells = error_cells(row, solved(plan))
            rows.append(row_of(label(row.name), *cells, tone="" if len(cells) > 1 else "unidentifiable"))
    columns = [("parameter", "left"), *ERROR_COLUMNS]
    return table_of("Bias and root mean square error, next to what was predicted", columns, rows)


def solved(plan: CoveragePlan) -> int:
    """The number of data sets, on which bias and rmse rest."""
    return max(1, plan.data_sets)


def _ranks_table(parts: Sequence[Calibration], bins: int) -> Table | None:
    rows = []
    for part in parts:
        rows.append(_group(part, 2))
        for row in part.parameters:
            chi2, p = row.chi2, row.p_value
            if chi2 is None or p is None:
                words = Cell(NOT_DETERMINED, span=2)
                rows.append(row_of(label(row.name), words, tone="unidentifiable"))
            else:
                rows.append(row_of(label(row.name), numbers.significant(chi2), numbers.p_value(p)))
    columns = [("parameter", "left"), (f"χ² ({bins - 1} degrees of freedom)", "right"), ("p-value", "right")]
    return table_of("Are the ranks uniform?", columns, rows) if rows else None


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


def comparison(plans: Sequence[CoveragePlan]) -> str:
    """How much worse the midpoint fit is, in a sentence; empty where no plan has both fits."""
    parts = []
    for plan in plans:
        if not (ratios := rmse_ratios(plan)):
            continue
        low, high = (choose(ratios, key=lambda own: own.ratio) for choose in (min, max))
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
                    entry = entries.get(level)
                    yield {
                        "plan": plan.name,
                        "estimator": estimator.name,
                        "control": estimator.control,
                        "parameter": parameter.name,
                        "status": parameter.status,
                        "level": level,
                        **share_columns(entry),
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
