"""The page of the study `cell`: the whole chain of the simulated cell, from plan to intervals."""

from __future__ import annotations

from collections.abc import Sequence

from ...experiments.procedure.session import PHASES
from ...experiments.studies.cell import CellPlan, CellStudy
from ...words import numbers
from ...words.wording import clipped, counted, listed, sentence
from ..style.blocks import FigureBlock, Legend, Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .coverage_page import shares_picture
from .study_figures import Across, Dot, Look, MarkRow, Scale, Stretch, rows_picture

# Phases are no statuses: one hue, from dark to faint, and in the order of the legend.
_SHADES = dict(zip(PHASES, (1.0, 0.66, 0.4, 0.2), strict=True))

PARAMETERS = blocks.flat(
    "plans parameters coverage",
    "plan=1.name control=1.control parameter=2.name unit=2.unit status=2.status level=0.settings.level"
    " held of share low high agrees" + "".join(f" {name}=2.{name}" for name in blocks.ERRORS.split()),
)
TIMES = blocks.flat("plans seconds", "plan=1.name phase=2.0 mean_s=2.1.mean max_s=2.1.max")
PLANS = blocks.flat(
    "plans",
    "plan=1.name control agrees robot shots joint_deg=1.noise.joint_deg spot_mm=1.noise.spot_mm runs failed"
    " refused contradicted within_limit shots_mean=1.shots_used.mean shots_min=1.shots_used.min"
    " shots_max=1.shots_used.max saved computing_s",
)


def cell_page(answer: CellStudy) -> Page:
    """The display strings of a study of the simulated cell."""
    settings, plans = answer.settings, answer.plans
    level, limit = settings.level, numbers.exact(settings.limit_s, "s")

    def cells(plan: CellPlan) -> list[str]:
        total = plan.seconds["total"]
        within = (
            blocks.NOT_GIVEN if plan.within_limit is None else "kept" if plan.within_limit else "exceeded"
        )
        return [blocks.worst_cell(plan, level), seconds(total.mean), seconds(total.max), within]

    sections = [
        section_of(
            "All plans",
            blocks.overview(
                f"{blocks.FARTHEST} {blocks.percent(level)}; mean and longest time of a run, and its limit",
                ["plan", "intervals", "farthest", "mean", "longest", "limit"],
                [("", "", plans)],
                cells,
                "llrrrl",
            ),
            Legend(blocks.meanings(plans), blocks.verdicts(plans)),
            Paragraph(blocks.BY_CHANCE),
        ),
        section_of(
            f"Time against the limit of {limit}",
            Paragraph("Simulated time of a run, by the cell’s own clock, with all repeated attempts."),
            FigureBlock("time"),
            _times(plans),
        ),
        section_of("Runs and measurements", _runs(plans), *map(_failures, plans)),
        section_of(
            f"How often the {blocks.percent(level)} intervals contain the true value",
            FigureBlock("coverage"),
            blocks.parts_table(
                f"{blocks.SHARES}; bias and root mean square error, next to what was predicted",
                [f"within {blocks.percent(level)}", *blocks.ERROR_COLUMNS],
                plans,
                blocks.share_and_errors,
            ),
        ),
    ]
    camera = "with" if settings.camera else "without"
    return blocks.view_of(
        answer,
        f"{settings.runs} simulated runs for each of {counted(len(plans), 'plan')}, {camera} camera",
        sections,
        "parameters.csv, time.csv and plans.csv hold the shares and errors, the times and the runs",
        details=[
            blocks.plans_in_words(
                plans,
                lambda plan: blocks.noise_in_words(plan.noise),
                lambda plan: f" of {clipped(plan.robot)}",
            )
        ],
    )


def seconds(value: float | None) -> str:
    """A time to three significant digits."""
    return blocks.NOT_GIVEN if value is None else numbers.significant(value, 3, "s")


def _times(plans: Sequence[CellPlan]) -> Table:
    rows = []
    for plan in plans:
        means = [seconds(plan.seconds[name].mean) for name in (*PHASES, "total")]
        rows.append(
            row_of(clipped(plan.name, blocks.LONGEST_NAME), *means, seconds(plan.seconds["total"].max))
        )
    heads = ["plan", *PHASES, "total", "longest"]
    return table_of("Mean time of a run by phase, and the longest run", heads, rows)


def _runs(plans: Sequence[CellPlan]) -> Table:
    heads = ["plan", "runs", "no result", "refused", "contradicted"]
    heads += ["used, mean", "range", "saved, mean", "computing"]
    rows = []
    for plan in plans:
        used = plan.shots_used
        rows.append(
            row_of(
                clipped(plan.name, blocks.LONGEST_NAME),
                *map(str, (plan.runs, plan.failed, plan.refused, plan.contradicted)),
                numbers.or_words(used.mean, blocks.NOT_GIVEN),
                blocks.NOT_GIVEN if used.min is None else f"{used.min} to {used.max}",
                numbers.or_words(plan.saved, "not adaptive", digits=2),
                seconds(plan.computing_s),
            )
        )
    caption = (
        "Runs, and how many have no result; measurements refused in all runs; runs that contradict the"
        " model; measurements used in a run, and saved by the adaptive order; real time to compute a run"
    )
    return table_of(caption, heads, rows)


def _failures(plan: CellPlan) -> Paragraph | None:
    """Why runs of a plan have no result; None where all have one."""
    if not plan.failures:
        return None
    failures = listed([sentence(failure) for failure in plan.failures])
    return Paragraph(f"{blocks.plan_title(plan.name)}, runs without a result: {failures}.")


def cell_pictures(answer: CellStudy) -> list[Picture | None]:
    plans, level = answer.plans, answer.settings.level
    # The panel is as wide as the fewest runs require; a plan without any has nothing to draw.
    ended = [plan.runs - plan.failed for plan in plans if plan.runs > plan.failed]
    title = f"How often the {blocks.percent(level)} intervals contain the true value, with binomial intervals"
    shares = shares_picture(plans, [level], min(ended, default=1), "coverage", title) if plans else None
    return [shares, _time_picture(plans, answer.settings.limit_s)]


def _time_picture(plans: Sequence[CellPlan], limit: float) -> Picture | None:
    """A bar for each plan: the mean time by phase, a whisker to the longest run, and the limit; None where no
    plan has a time."""
    plans = [plan for plan in plans if plan.seconds["total"].mean is not None]
    if not plans:
        return None
    rows, texts, longest = [], [], max(plan.seconds["total"].max or 0.0 for plan in plans)
    for plan in plans:
        total, begin = plan.seconds["total"], 0.0
        bars: list[Dot | Stretch] = []
        for phase in PHASES:
            mean = plan.seconds[phase].mean or 0.0
            bars.append(Stretch(begin, begin + mean, _SHADES[phase], 0.6))
            begin += mean
        bars.append(Dot(total.max or 0.0, begin, total.max, Look(role="ink", shape="|", size=7)))
        words = f"{seconds(total.mean)}, longest {seconds(total.max)}"
        rows += [MarkRow(f"{clipped(plan.name, 36)}: {words}", head=True), MarkRow("", [bars])]
        phases = ", ".join(f"{phase} {seconds(plan.seconds[phase].mean)}" for phase in PHASES)
        texts.append(f"{clipped(plan.name, 40)}: {words} ({phases})")
    limit_text = numbers.exact(limit, "s")
    return rows_picture(
        "time",
        f"Simulated time of a run by phase, mean; whisker: the longest run; line: the limit of {limit:g} s",
        f"Mean time of a run, against the limit of {limit_text}. {'; '.join(texts)}.",
        rows,
        [Across("time of a run, s", Scale(ends=(0.0, 1.03 * max(limit, longest))), [limit], limit_text)],
        [(Stretch(0, 1, shade), phase) for phase, shade in _SHADES.items()],
        row_height=0.23,
    )
