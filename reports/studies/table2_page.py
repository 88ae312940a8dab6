"""The page of the study `table2`: the scatter of the paper's three runs against the predicted one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...experiments.studies.table2 import PaperTable, ScatterParameter, Table2Plan, Table2Study
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label, sentence
from ..style.blocks import Cell, FigureBlock, Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .study_figures import Across, Dot, Look, MarkRow, Scale, Stretch, rows_picture

_PAPER, _OURS = 0.2, -0.19  # above the middle of a row
_BAR = Stretch(0, 0, 0.25, 0.26, _OURS)
_THE_PAPER, _PREDICTED = Look(role="ink"), Look(shape="D", stroke="")
_ONE_SET, _MEDIAN = Look(shape="s", stroke="", filled=False, size=4.6), Look(shape="|", size=6)

SCATTER = blocks.flat(
    "plans parameters",
    "plan=1.name parameter=2.name unit status paper_std low high predicted_std alone_deg simulated_std"
    " simulated_q2_5=2.simulated.q2_5 simulated_median=2.simulated.median simulated_q97_5=2.simulated.q97_5",
)
PLANS = blocks.flat("plans", "plan=1.name shots spot_mm joint_deg low high p_value agrees chi2 dof chance")


def table2_page(answer: Table2Study) -> Page:
    """The display strings of the study of the paper's Table 2."""
    settings, plans, paper = answer.settings, answer.plans, answer.paper
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
            "What the paper prints", _paper(paper), *(Paragraph(sentence(one)) for one in paper.notes)
        ),
    ]
    return blocks.view_of(
        answer,
        f"the paper’s Table 2 against {settings.simulated} simulated sets of {settings.runs} runs",
        sections,
        "scatter.csv, plans.csv and paper.csv hold the standard deviations, the joint noise and the paper’s"
        " table",
        details=[blocks.plans_in_words(plans, lambda plan: f"spot {numbers.exact(plan.spot_mm, 'mm')}")],
    )


def _overview(plans: Sequence[Table2Plan]) -> Table:
    rows = []
    for plan in plans:
        verdict = Cell("no result", mark="weak") if plan.chi2 is None else blocks.standing_cell(plan)
        rows.append(
            row_of(
                clipped(plan.name, blocks.LONGEST_NAME),
                joint_noise(plan),
                blocks.spread_range(plan.low, plan.high, "deg"),
                blocks.NOT_GIVEN if plan.p_value is None else numbers.p_value(plan.p_value),
                verdict,
                tone=verdict.mark,
            )
        )
    caption = (
        "Standard deviation of one joint reading that would explain the paper’s; p-value of one for all"
        " offsets; whether a simulated set scatters as predicted"
    )
    heads = ["plan", "joint noise", "95 % interval", "p-value, one for all", "simulated set"]
    return table_of(caption, heads, rows, "lrrrl")


def _in_words(plan: Table2Plan) -> str:
    """The plan's sentence, and how its simulated set compares with the prediction."""
    text = f"{blocks.plan_title(plan.name)}: {sentence(plan.sentence).rstrip('.')}."
    if plan.chi2 is None or plan.chance is None:
        return f"{text} A run of the simulated set has no result."
    return (
        f"{text} The simulated set: χ² {numbers.significant(plan.chi2)} for {plan.dof} degrees of"
        f" freedom, p {numbers.p_value(plan.chance)}."
    )


def _scatter(plan: Table2Plan) -> Table:
    heads = ["offset", "paper", "95 % of the true one", "predicted", "one simulated set"]
    heads += ["95 % of the sets", "joint noise required alone"]
    rows = []
    for row in plan.parameters:
        name, unit, sets = label(row.name), row.unit, row.simulated
        paper = [blocks.spread(row.paper_std, unit), blocks.spread_range(row.low, row.high, unit)]
        if not row.has_numbers:
            rows.append(row_of(name, *paper, Cell(blocks.NOT_DETERMINED, span=4), tone="unidentifiable"))
            continue
        ours = [blocks.spread(row.predicted_std, unit), blocks.spread(row.simulated_std, unit)]
        between = blocks.NOT_GIVEN if sets is None else blocks.spread_range(sets.q2_5, sets.q97_5, unit)
        rows.append(row_of(name, *paper, *ours, between, blocks.spread(row.alone_deg, "deg")))
    return table_of(
        f"{blocks.plan_title(plan.name)}: standard deviations over the runs of a set", heads, rows
    )


def _paper(paper: PaperTable) -> Table:
    """The paper's table as it was printed, and what follows from its runs to as many decimals."""
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
    return table_of("Joint offsets of three runs (Table 2)", ["", *map(label, paper.offsets)], rows)


def _degrees(values: Sequence[float], printed: Sequence[float]) -> list[str]:
    """`values` with the most decimals that any of `printed` has."""
    digits = max(len(f"{value:.10g}".partition(".")[2]) for value in printed)
    return [numbers.with_unit(numbers.fixed(value, digits), "deg") for value in values]


def joint_noise(plan: Table2Plan) -> str:
    """The joint noise that explains the scatter, rounded by its own interval."""
    at, low, high = plan.joint_deg, plan.low, plan.high
    if at is None:
        return blocks.NOT_GIVEN
    if low is None or high is None or high <= low:
        return numbers.significant(at, 2, "deg")
    return numbers.estimate(at, (high - low) / (2 * NORMAL_95), "deg")


def table2_pictures(answer: Table2Study) -> list[Picture | None]:
    """Logarithmic; rows are the offsets of each plan: above the paper's std with its interval, below ours."""
    rows, texts = [], []
    for plan in answer.plans:
        rows.append(MarkRow(f"plan {clipped(plan.name, 30)}, joint noise {joint_noise(plan)}", head=True))
        rows += [_row(row) for row in plan.parameters]
        offsets = []
        for row in plan.parameters:
            between = blocks.spread_range(row.low, row.high, row.unit)
            ours = (
                f"predicted {blocks.spread(row.predicted_std, row.unit)}"
                if row.has_numbers
                else blocks.NOT_DETERMINED
            )
            offsets.append(
                f"{label(row.name)} paper {blocks.spread(row.paper_std, row.unit)} ({between}), {ours}"
            )
        texts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(offsets)}")
    if not any(row.paper_std for plan in answer.plans for row in plan.parameters):
        return [None]
    units = dict.fromkeys(numbers.symbol(row.unit) for plan in answer.plans for row in plan.parameters)
    return [
        rows_picture(
            "scatter",
            "Standard deviation of each offset over three runs: the paper’s, and what the noise predicts",
            f"Standard deviations of the offsets. {'. '.join(texts)}.",
            rows,
            [Across(f"standard deviation, {', '.join(units)}", Scale(log=True))],
            [
                (_THE_PAPER, "paper, 95 %"),
                (_PREDICTED, "predicted"),
                (_ONE_SET, "one simulated set"),
                (_BAR, "95 % of the sets, median"),
            ],
            row_height=0.3,
        )
    ]


def _row(row: ScatterParameter) -> MarkRow:
    marks: list[Dot | Stretch] = []
    if row.paper_std:
        words = blocks.spread(row.paper_std, row.unit)
        marks.append(Dot(row.paper_std, row.low, row.high, _THE_PAPER, words, up=_PAPER))
    if row.simulated is not None:
        marks.append(replace(_BAR, low=row.simulated.q2_5, high=row.simulated.q97_5))
        marks.append(Dot(row.simulated.median, look=_MEDIAN, up=_OURS))
    for at, look in ((row.predicted_std, _PREDICTED), (row.simulated_std, _ONE_SET)):
        marks += [Dot(at, look=look, up=_OURS)] if at else []
    return MarkRow(label(row.name, 9), [marks], "" if row.has_numbers else blocks.NOT_DETERMINED)


def paper_rows(answer: Table2Study) -> Iterator[blocks.PlainRow]:
    """One row for each offset of the paper's table, degrees."""
    paper = answer.paper
    for i, name in enumerate(paper.offsets):
        yield {
            "parameter": name,
            **{f"experiment_{k}": run[i] for k, run in enumerate(paper.experiments, start=1)},
            **{key: getattr(paper, key)[i] for key in ("mean", "std", "printed_mean", "printed_std")},
        }
