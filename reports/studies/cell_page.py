"""The page of the study `cell`: the whole chain of the simulated cell, from plan to intervals."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.patches import Patch

from ...experiments.procedure.session import PHASES
from ...experiments.studies.cell import CellPlan, CellSettings, CellStudy
from ...words import numbers
from ...words.wording import clipped, counted, listed, sentence
from ..style.blocks import (
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
from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .coverage_figures import coverage_picture
from .study_blocks import (
    BY_CHANCE,
    ERROR_COLUMNS,
    LONGEST_NAME,
    NOT_GIVEN,
    PlainRow,
    columns_of,
    how_it_was_done,
    meanings,
    noise_in_words,
    parameter_columns,
    percent,
    plan_in_words,
    plan_title,
    rows_of,
    seconds,
    share_and_errors,
    standing_cell,
    verdicts,
    view_of,
    worst_cell,
)

# Phases are no statuses: one hue, from dark to faint, and in the order of the legend.
_SHADES = dict(zip(PHASES, (1.0, 0.66, 0.4, 0.2), strict=True))
_BAR = 0.4  # of a row's height


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
        how_it_was_done(
            answer,
            [
                ("Runs of each plan", str(settings.runs)),
                ("Seed", str(settings.seed)),
                ("Level of the intervals", percent(settings.level)),
                ("Probability of a false alarm", percent(settings.chance)),
                ("Limit of a run’s time", limit),
                ("Search", "by camera images" if settings.camera else "without a camera"),
            ],
            "parameters.csv, time.csv and plans.csv hold the shares and errors, the times and the runs",
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
    columns = ["plan", "intervals", "farthest", "mean", "longest", "limit"]
    rows = []
    for plan in plans:
        verdict, total = standing_cell(plan), plan.seconds["total"]
        within = NOT_GIVEN if plan.within_limit is None else "kept" if plan.within_limit else "exceeded"
        worst, times = worst_cell(plan, settings.level), [seconds(total.mean), seconds(total.max)]
        rows.append(
            row_of(clipped(plan.name, LONGEST_NAME), verdict, worst, *times, within, tone=verdict.mark)
        )
    caption = (
        "Share of intervals that hold the truth, in %: the parameter farthest from"
        f" {percent(settings.level)}; mean and longest time of a run, and its limit"
    )
    return table_of(caption, columns, rows, "llrrrl")


def _parameters(plans: Sequence[CellPlan], level: float) -> Table:
    columns = ["parameter", f"within {percent(level)}", *ERROR_COLUMNS]
    width = len(columns) - 1
    rows = [row for plan in plans for row in rows_of(plan, plan.words, width, share_and_errors)]
    caption = (
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval; bias and root mean"
        " square error, next to what was predicted"
    )
    return table_of(caption, columns, rows)


def _time(plans: Sequence[CellPlan]) -> Table:
    columns = ["plan", *PHASES, "total", "longest"]
    rows = []
    for plan in plans:
        means = [seconds(plan.seconds[name].mean) for name in (*PHASES, "total")]
        longest = seconds(plan.seconds["total"].max)
        rows.append(row_of(clipped(plan.name, LONGEST_NAME), *means, longest))
    return table_of("Mean time of a run by phase, and the longest run", columns, rows)


def _runs(plans: Sequence[CellPlan]) -> Table:
    columns = [
        "plan",
        "runs",
        "no result",
        "refused",
        "contradicted",
        "used, mean",
        "range",
        "saved, mean",
        "computing",
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
    if not plan.failures:
        return None
    failures = listed([sentence(failure) for failure in plan.failures])
    return Paragraph(f"{plan_title(plan.name)}, runs without a result: {failures}.")


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
    # The panel is as wide as the fewest runs require; a plan without any has nothing to draw.
    fewest = min((solved(plan) for plan in plans if plan.runs > plan.failed), default=1)
    intervals = f"How often the {percent(level)} intervals hold the truth, with binomial intervals"
    shares = coverage_picture(plans, [level], fewest, "coverage", intervals) if plans else None
    return [shares, time_picture(plans, answer.settings.limit_s)]


# ── the time of a run, by phase ───────────────────────────────────────────────────────────────


def time_picture(plans: Sequence[CellPlan], limit: float) -> Picture | None:
    """A bar for each plan: the mean time by phase, a whisker to the longest run, and the limit.

    None where no plan has a time.
    """
    plans = [plan for plan in plans if plan.seconds["total"].mean is not None]
    if not plans:
        return None
    with style():
        figure = new_figure(0.85 + 0.46 * len(plans))
        axes = figure.subplots()
        for y, plan in enumerate(plans):
            _bar(axes, y, plan)
        _finish_times(axes, len(plans), limit, max(plan.seconds["total"].max or 0.0 for plan in plans))
        svg = to_svg(figure, "time")
    title = (
        f"Simulated time of a run by phase, mean; whisker: the longest run; line: the limit of {limit:g} s"
    )
    return Picture("time", title, _times_alt(plans, limit), svg)


def _bar(axes: Axes, y: int, plan: CellPlan) -> None:
    spent, begin = plan.seconds, 0.0
    for phase in PHASES:
        mean = spent[phase].mean or 0.0
        # On the ground's colour, so that the grid does not show through.
        for colour, alpha in ((light("ground"), 1.0), (light("identified"), _SHADES[phase])):
            axes.barh(y, mean, _BAR, begin, color=colour, alpha=alpha, linewidth=0)
        begin += mean
    longest = spent["total"].max or 0.0
    axes.plot([begin, longest], [y, y], "-", linewidth=1.2, color=light("ink"))
    axes.plot([longest], [y], "|", markersize=7, markeredgewidth=1.2, color=light("ink"))
    axes.annotate(
        in_font(f"{clipped(plan.name, 36)}: {_time_in_words(plan)}"),
        (0, y - _BAR / 2),
        xytext=(0, 2.5),
        textcoords="offset points",
        fontsize=8.5,
        bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.8},
    )


def _time_in_words(plan: CellPlan) -> str:
    total = plan.seconds["total"]
    return f"{seconds(total.mean)}, longest {seconds(total.max)}"


def _finish_times(axes: Axes, count: int, limit: float, longest: float) -> None:
    axes.set_ylim(count - 0.65, -0.72)
    axes.set_yticks([])
    axes.set_xlim(0, 1.03 * max(limit, longest))
    bare_y(axes)
    axes.axvline(limit, color=light("weak"), linewidth=1.2, zorder=0.6)
    axes.set_xlabel("time of a run, s")
    axes.legend(
        handles=[
            Patch(color=light("identified"), alpha=shade, linewidth=0, label=phase)
            for phase, shade in _SHADES.items()
        ],
        loc="lower left",
        bbox_to_anchor=(-0.01, 1.0),
        ncols=len(PHASES),
        columnspacing=1.4,
        handlelength=1.1,
        handleheight=0.9,
    )
    axes.annotate(
        f"{numbers.exact(limit, 's')}",
        (limit, 1),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        fontsize=8.5,
        color=light("weak"),
    )


def _times_alt(plans: Sequence[CellPlan], limit: float) -> str:
    parts = []
    for plan in plans:
        phases = ", ".join(f"{phase} {seconds(plan.seconds[phase].mean)}" for phase in PHASES)
        parts.append(f"{clipped(plan.name, 40)}: {_time_in_words(plan)} ({phases})")
    return f"Mean time of a run, against the limit of {numbers.exact(limit, 's')}. {'; '.join(parts)}."


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def parameter_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan and parameter; nothing but names where the plan does not determine it."""
    for plan in answer.plans:
        for row in plan.parameters:
            yield parameter_columns(plan, row, answer.settings.level, plan=plan.name)


def time_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan and phase, and one for its total, seconds."""
    for plan in answer.plans:
        for phase in (*PHASES, "total"):
            spent = plan.seconds[phase]
            yield {"plan": plan.name, "phase": phase, "mean_s": spent.mean, "max_s": spent.max}


def plan_rows(answer: CellStudy) -> Iterator[PlainRow]:
    """One row for each plan."""
    for plan in answer.plans:
        yield {
            "plan": plan.name,
            **columns_of(plan, "control", "agrees", "robot", "shots"),
            **columns_of(plan.noise, "joint_deg", "spot_mm"),
            **columns_of(plan, "runs", "failed", "refused", "contradicted", "within_limit"),
            **columns_of(plan.shots_used, "mean", "min", "max", prefix="shots_"),
            **columns_of(plan, "saved", "computing_s"),
        }
