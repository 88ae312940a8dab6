"""The page of the study `cell`: the whole chain of the simulated cell, from plan to intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...experiments.procedure.session import PHASES
from ...experiments.studies.cell_answer import CellPlan, CellSettings, CellStudy
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, sentence
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    Page,
    Paragraph,
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
    NOT_GIVEN,
    about_study,
    files_block,
    noise_in_words,
    plan_in_words,
    plan_title,
    seconds,
    view_of,
)
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
from .time_figure import time_picture

_COUNTS = ("runs", "failed", "refused", "contradicted", "within_limit")
_ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std")


def cell_page(answer: CellStudy) -> Page:
    """The display strings of a study of the simulated cell."""
    settings, plans = answer.settings, answer.plans
    limit = numbers.exact(settings.limit_s, "s")
    sections = [
        section_of(
            "All plans",
            _overview(plans, settings),
            Legend(meanings(plans), verdicts(plans)),
            Paragraph(BY_CHANCE),
        ),
        section_of(
            f"Time against the limit of {limit}",
            Paragraph("Simulated time of a run, by the cell’s own clock, with all repeated attempts."),
            FigureBlock("time"),
            _time(plans),
        ),
        section_of("Runs and measurements", _runs(plans), *map(_failures, plans)),
        section_of(
            f"How often the {percent(settings.level)} intervals hold the truth",
            FigureBlock("coverage"),
            _parameters(plans, settings.level),
        ),
        section_of(
            "How it was done",
            about_study(
                answer,
                [
                    ("Runs of each plan", str(settings.runs)),
                    ("Seed", str(settings.seed)),
                    ("Level of the intervals", percent(settings.level)),
                    ("Chance of a false alarm", percent(settings.chance)),
                    ("Limit of a run’s time", limit),
                    ("Search", "by camera images" if settings.camera else "without a camera"),
                ],
            ),
            files_block(
                "parameters.csv, time.csv and plans.csv hold the shares and errors, the times and the runs"
            ),
        ),
        section_of("Plans", Facts(_plans(plans)), level=2),
    ]
    camera = "with" if settings.camera else "without"
    subtitle = f"{settings.runs} simulated runs for each of {counted(len(plans), 'plan')}, {camera} camera"
    return view_of(answer, f"{subtitle}, seed {settings.seed}", sections)


def solved(plan: CellPlan) -> int:
    """The number of runs with a result, at least one."""
    return max(1, plan.runs - plan.failed)


def _overview(plans: Sequence[CellPlan], settings: CellSettings) -> Table:
    # The verdict second, so that a phone shows it without scrolling.
    columns = [
        ("plan", "left"),
        ("intervals", "left"),
        ("farthest", "right"),
        ("mean", "right"),
        ("longest", "right"),
        ("limit", "left"),
    ]
    rows = []
    for plan in plans:
        mark, words = standing(plan)
        total = plan.seconds["total"]
        rows.append(
            row_of(
                clipped(plan.name, LONGEST_NAME),
                Cell(words, mark=mark),
                worst_cell(plan, settings.level),
                seconds(total.mean),
                seconds(total.max),
                _within(plan),
                tone=mark,
            )
        )
    caption = (
        "Share of intervals that hold the truth, in %: the parameter farthest from"
        f" {percent(settings.level)}; mean and longest time of a run, and its limit"
    )
    return table_of(caption, columns, rows)


def _within(plan: CellPlan) -> Cell:
    if plan.within_limit is None:
        return Cell(NOT_GIVEN)
    return Cell("kept" if plan.within_limit else "exceeded")


def _parameters(plans: Sequence[CellPlan], level: float) -> Table:
    columns = [("parameter", "left"), (f"within {percent(level)}", "right"), *ERROR_COLUMNS]
    rows = []
    for plan in plans:
        mark, words = standing(plan)
        about = f"{sentence(plan.words)} ({words})"
        rows.append(row_of(clipped(plan.name, LONGEST_NAME), Cell(about, span=len(columns) - 1), tone=mark))
        for row in plan.parameters:
            name = label(row.name)
            if row.coverage is None:
                undetermined = Cell(NOT_DETERMINED, span=len(columns) - 1)
                rows.append(row_of(name, undetermined, tone="unidentifiable"))
                continue
            cell = share_cell(row.coverage, plan.control)
            rows.append(row_of(name, cell, *error_cells(row, row.coverage.of), tone=cell.mark))
    caption = (
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval; bias and root mean"
        " square error, next to what was predicted"
    )
    return table_of(caption, columns, rows)


def _time(plans: Sequence[CellPlan]) -> Table:
    columns = [("plan", "left"), *((name, "right") for name in (*PHASES, "total", "longest"))]
    rows = []
    for plan in plans:
        found = plan.seconds
        means = [seconds(found[name].mean) for name in (*PHASES, "total")]
        rows.append(row_of(clipped(plan.name, LONGEST_NAME), *means, seconds(found["total"].max)))
    return table_of("Mean time of a run by phase, and the longest run", columns, rows)


def _runs(plans: Sequence[CellPlan]) -> Table:
    columns = [
        ("plan", "left"),
        ("runs", "right"),
        ("no result", "right"),
        ("refused", "right"),
        ("contradicted", "right"),
        ("used, mean", "right"),
        ("range", "right"),
        ("saved, mean", "right"),
        ("computing", "right"),
    ]
    rows = []
    for plan in plans:
        used = plan.shots_used
        rows.append(
            row_of(
                clipped(plan.name, LONGEST_NAME),
                str(plan.runs),
                str(plan.failed),
                str(plan.refused),
                str(plan.contradicted),
                NOT_GIVEN if used.mean is None else numbers.significant(used.mean),
                NOT_GIVEN if used.min is None else f"{used.min} to {used.max}",
                "not adaptive" if plan.saved is None else numbers.significant(plan.saved, 2),
                seconds(plan.computing_s),
            )
        )
    caption = (
        "Runs, and how many have no result; measurements refused in all runs; runs that contradict the"
        " model; measurements used in a run, and saved by the adaptive order; real time to compute a run"
    )
    return table_of(caption, columns, rows)


def _failures(plan: CellPlan) -> Paragraph | None:
    """Why runs of a plan have no result; None where all have one."""
    found = [sentence(failure) for failure in plan.failures]
    return Paragraph(f"{plan_title(plan.name)}, runs without a result: {listed(found)}.") if found else None


def _plans(plans: Sequence[CellPlan]) -> list[tuple[str, str]]:
    return [
        (
            clipped(plan.name, LONGEST_NAME),
            plan_in_words(plan.words, plan.shots, noise_in_words(plan.noise), plan.robot),
        )
        for plan in plans
    ]


def cell_pictures(answer: CellStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    # The panel is as wide as the fewest runs ask for; a plan without any has nothing to draw.
    fewest = min((solved(plan) for plan in plans if plan.runs > plan.failed), default=1)
    intervals = f"How often the {percent(level)} intervals hold the truth, with binomial intervals"
    shares = coverage_picture(plans, [level], fewest, "coverage", intervals) if plans else None
    return [shares, time_picture(plans, answer.settings.limit_s)]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def parameter_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan and parameter; nothing but names where the plan does not determine it."""
    for plan in answer.plans:
        for row in plan.parameters:
            yield {
                "plan": plan.name,
                "control": plan.control,
                "parameter": row.name,
                "unit": row.unit,
                "status": row.status,
                "level": answer.settings.level,
                **share_columns(row.coverage),
                **{key: getattr(row, key) for key in _ERRORS},
            }


def time_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan and phase, and one for its total, seconds."""
    for plan in answer.plans:
        for phase in (*PHASES, "total"):
            found = plan.seconds[phase]
            yield {"plan": plan.name, "phase": phase, "mean_s": found.mean, "max_s": found.max}


def plan_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan."""
    for plan in answer.plans:
        yield {
            "plan": plan.name,
            **{key: getattr(plan, key) for key in ("control", "agrees", "robot", "shots")},
            "joint_deg": plan.noise.joint_deg,
            "spot_mm": plan.noise.spot_mm,
            **{
                key: getattr(plan, key)
                for key in ("runs", "failed", "refused", "contradicted", "within_limit")
            },
            **{f"shots_{key}": getattr(plan.shots_used, key) for key in ("mean", "min", "max")},
            **{key: getattr(plan, key) for key in ("saved", "computing_s")},
        }
