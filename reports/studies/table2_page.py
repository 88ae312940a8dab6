"""The page of the study `table2`: the scatter of the paper's three runs against the predicted one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...experiments.studies.table2 import PaperTable, ScatterParameter, Table2Plan, Table2Study
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label, sentence
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import light
from .coverage_figures import head_rows, name_rows
from .study_blocks import (
    LONGEST_NAME,
    NOT_DETERMINED,
    NOT_GIVEN,
    STANDING,
    PlainRow,
    columns_of,
    how_it_was_done,
    plan_in_words,
    plan_title,
    spread,
    spread_range,
    view_of,
)

_PAPER, _OURS = -0.2, 0.19  # the positions of the two in a row


def table2_page(answer: Table2Study) -> Page:
    """The display strings of the study of the paper's Table 2."""
    settings, plans, paper = answer.settings, answer.plans, answer.paper
    triples = f"{settings.simulated} simulated sets of {settings.runs} runs"
    sections = [
        section_of(
            "The joint noise that would explain the scatter",
            _overview(plans),
            *(Paragraph(_in_words(plan)) for plan in plans),
        ),
        section_of(
            "Scatter of each offset",
            Paragraph(
                f"A standard deviation of {settings.runs} runs determines the true one only to a wide"
                " interval: compare intervals, not dots. The prediction is for the joint noise above."
            ),
            FigureBlock("scatter"),
            *(_scatter(plan) for plan in plans),
        ),
        section_of(
            "What the paper prints",
            _paper(paper),
            *(Paragraph(sentence(note)) for note in paper.notes),
        ),
        how_it_was_done(
            answer,
            [
                ("Runs in a set", str(settings.runs)),
                ("Simulated sets", str(settings.simulated)),
                ("Seed", str(settings.seed)),
            ],
            "scatter.csv, plans.csv and paper.csv hold the standard deviations, the joint noise and the"
            " paper’s table",
        ),
        section_of("Plans", Facts(_plans(plans)), level=2),
    ]
    return view_of(answer, f"the paper’s Table 2 against {triples}, seed {settings.seed}", sections)


def _overview(plans: Sequence[Table2Plan]) -> Table:
    columns = ["plan", "joint noise", "95 % interval", "p-value, one for all", "simulated set"]
    rows = [
        row_of(
            clipped(plan.name, LONGEST_NAME),
            joint_noise(plan),
            spread_range(plan.low, plan.high, "deg"),
            NOT_GIVEN if plan.p_value is None else numbers.p_value(plan.p_value),
            (verdict := _as_predicted(plan)),
            tone=verdict.mark,
        )
        for plan in plans
    ]
    caption = (
        "Standard deviation of one joint reading that would explain the paper’s; p-value of one for all"
        " offsets; whether a simulated set scatters as predicted"
    )
    return table_of(caption, columns, rows, "lrrrl")


def _as_predicted(plan: Table2Plan) -> Cell:
    if plan.chi2 is None:
        return Cell("no result", mark="weak")
    mark, words = STANDING[False, plan.agrees]
    return Cell(words, mark=mark)


def _in_words(plan: Table2Plan) -> str:
    """The plan's sentence, and how its simulated set compares with the prediction."""
    text = f"{plan_title(plan.name)}: {sentence(plan.sentence).rstrip('.')}."
    if plan.chi2 is None or plan.chance is None:
        return f"{text} A run of the simulated set has no result."
    return (
        f"{text} The simulated set: χ² {numbers.significant(plan.chi2)} for {plan.dof} degrees of"
        f" freedom, p {numbers.p_value(plan.chance)}."
    )


def _scatter(plan: Table2Plan) -> Table:
    columns = [
        "offset",
        "paper",
        "95 % of the true one",
        "predicted",
        "one simulated set",
        "95 % of the sets",
        "joint noise required alone",
    ]
    rows = []
    for row in plan.parameters:
        name, unit = label(row.name), row.unit
        paper = [spread(row.paper_std, unit), spread_range(row.low, row.high, unit)]
        if not row.has_numbers:
            undetermined = Cell(NOT_DETERMINED, span=len(columns) - 3)
            rows.append(row_of(name, *paper, undetermined, tone="unidentifiable"))
            continue
        simulated = row.simulated
        rows.append(
            row_of(
                name,
                *paper,
                spread(row.predicted_std, unit),
                spread(row.simulated_std, unit),
                NOT_GIVEN if simulated is None else spread_range(simulated.q2_5, simulated.q97_5, unit),
                spread(row.alone_deg, "deg"),
            )
        )
    return table_of(f"{plan_title(plan.name)}: standard deviations over the runs of a set", columns, rows)


def _paper(paper: PaperTable) -> Table:
    """The paper's table as it was printed, and what follows from its runs to as many decimals."""
    columns = ["", *map(label, paper.offsets)]
    printed_runs = [value for run in paper.experiments for value in run]
    rows = [
        row_of(f"experiment {i}", *_degrees(run, printed_runs))
        for i, run in enumerate(paper.experiments, start=1)
    ]
    for name, printed, recomputed in (
        ("mean", paper.printed_mean, paper.mean),
        ("std", paper.printed_std, paper.std),
    ):
        for words, values in ((f"{name}, printed", printed), (f"{name}, recomputed", recomputed)):
            rows.append(row_of(words, *_degrees(values, printed)))
    return table_of("Joint offsets of three runs (Table 2)", columns, rows)


def _degrees(values: Sequence[float], printed: Sequence[float]) -> list[str]:
    """`values` with the most decimals that any of `printed` has."""
    digits = max(len(f"{value:.10g}".partition(".")[2]) for value in printed)
    return [numbers.with_unit(numbers.fixed(value, digits), "deg") for value in values]


def _plans(plans: Sequence[Table2Plan]) -> list[tuple[str, str]]:
    return [
        (
            clipped(plan.name, LONGEST_NAME),
            plan_in_words(plan.words, plan.shots, f"spot {numbers.exact(plan.spot_mm, 'mm')}"),
        )
        for plan in plans
    ]


# ── the scatter of the runs against the predicted one ─────────────────────────────────────────


def joint_noise(plan: Table2Plan) -> str:
    """The joint noise that explains the scatter, rounded by its own interval."""
    at, low, high = plan.joint_deg, plan.low, plan.high
    if at is None:
        return NOT_GIVEN
    if low is None or high is None or high <= low:
        return numbers.significant(at, 2, "deg")
    return numbers.estimate(at, (high - low) / (2 * NORMAL_95), "deg")


def table2_pictures(answer: Table2Study) -> list[Picture | None]:
    """Logarithmic; rows are the offsets of each plan: above the paper's std with its interval, below ours."""
    plans = answer.plans
    rows = [(plan, row) for plan in plans for row in (None, *plan.parameters)]
    if not any(row is not None and row.paper_std for _, row in rows):
        return [None]
    with style():
        figure = new_figure(0.3 * len(rows) + 0.85)
        axes = figure.subplots()
        axes.set_xscale("log")
        for y, (plan, row) in enumerate(rows):
            if row is None:
                text = f"plan {clipped(plan.name, 30)}, joint noise {joint_noise(plan)}"
                head_rows(axes, y + 0.1, text, 9, pad=1)
            else:
                _draw_paper(axes, y + _PAPER, row)
                _ours(axes, y + _OURS, row)
        _finish(figure, axes, [(y, row) for y, (_, row) in enumerate(rows) if row is not None], len(rows))
        svg = to_svg(figure, "scatter")
    title = (
        "Standard deviation of each offset over three runs: the paper’s, and what the joint noise predicts"
    )
    return [Picture("scatter", title, _alt(plans), svg)]


def _draw_paper(axes: Axes, y: float, row: ScatterParameter) -> None:
    if not row.paper_std:
        return
    ink = light("ink")
    if row.low and row.high:
        axes.plot([row.low, row.high], [y, y], "-", linewidth=1.5, color=ink)
    axes.plot([row.paper_std], [y], "o", markersize=4.2, color=ink)
    axes.annotate(
        spread(row.paper_std, row.unit),
        (row.high or row.paper_std, y),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=8,
    )


def _ours(axes: Axes, y: float, row: ScatterParameter) -> None:
    if not row.has_numbers:
        hatched(axes, y, NOT_DETERMINED, half=0.15, size=8)
        return
    blue, simulated = light("identified"), row.simulated
    if simulated is not None:
        width = simulated.q97_5 - simulated.q2_5
        axes.barh(y, width, 0.26, simulated.q2_5, color=blue, alpha=0.25, linewidth=0)
        axes.plot([simulated.median], [y], "|", markersize=6, markeredgewidth=1.2, color=blue)
    if row.predicted_std:
        axes.plot([row.predicted_std], [y], "D", markersize=4.2, color=blue)
    if row.simulated_std:
        axes.plot([row.simulated_std], [y], "s", markersize=4.6, color=blue, markerfacecolor=light("ground"))


def _finish(figure: Figure, axes: Axes, rows: list[tuple[int, ScatterParameter]], count: int) -> None:
    axes.set_ylim(count - 0.4, -0.55)
    name_rows(axes, [(y, label(row.name, 9)) for y, row in rows], 9)
    bare_y(axes)
    axes.minorticks_off()
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * 2.2)  # room for the numbers
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    units = dict.fromkeys("°" if row.unit == "deg" else str(row.unit) for _, row in rows)
    axes.set_xlabel(f"standard deviation, {', '.join(units)}")
    blue = light("identified")
    dot = partial(Line2D, [], [], markersize=4.2, linewidth=0, color=blue)
    figure.legend(
        handles=[
            Line2D(
                [], [], marker="o", markersize=4.2, linewidth=1.5, color=light("ink"), label="paper, 95 %"
            ),
            dot(marker="D", label="predicted"),
            dot(marker="s", label="one simulated set", markerfacecolor=light("ground")),
            Patch(color=blue, alpha=0.25, linewidth=0, label="95 % of the sets, median"),
        ],
        loc="outside upper left",
        ncols=4,
        columnspacing=1.1,
        handlelength=1.3,
        handletextpad=0.5,
    )


def _alt(plans: Sequence[Table2Plan]) -> str:
    parts = []
    for plan in plans:
        offsets = []
        for row in plan.parameters:
            unit = row.unit
            paper = f"{label(row.name)} paper {spread(row.paper_std, unit)}"
            paper += f" ({spread_range(row.low, row.high, unit)})"
            ours = f"predicted {spread(row.predicted_std, unit)}" if row.has_numbers else NOT_DETERMINED
            offsets.append(f"{paper}, {ours}")
        parts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(offsets)}")
    return f"Standard deviations of the offsets. {'. '.join(parts)}."


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def scatter_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each plan and offset; of the paper only where the plan does not determine the offset."""
    for plan in answer.plans:
        for row in plan.parameters:
            yield {
                "plan": plan.name,
                "parameter": row.name,
                **columns_of(row, "unit", "status", "paper_std", "low", "high"),
                **columns_of(row, "predicted_std", "alone_deg", "simulated_std"),
                **columns_of(row.simulated, "q2_5", "median", "q97_5", prefix="simulated_"),
            }


def plan_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each plan."""
    keys = ("shots", "spot_mm", "joint_deg", "low", "high", "p_value", "agrees", "chi2", "dof", "chance")
    for plan in answer.plans:
        yield {"plan": plan.name, **columns_of(plan, *keys)}


def paper_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each offset of the paper's table, degrees."""
    paper = answer.paper
    for i, name in enumerate(paper.offsets):
        yield {
            "parameter": name,
            **{f"experiment_{k}": run[i] for k, run in enumerate(paper.experiments, start=1)},
            **{key: getattr(paper, key)[i] for key in ("mean", "std", "printed_mean", "printed_std")},
        }
