"""The study `table2`: the scatter of the paper's three runs against the predicted one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from ...experiments.studies.table2 import PaperTable, ScatterParameter, Table2Plan, Table2Study
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label, sentence
from ..style.blocks import Cell, FigureBlock, Paragraph, Section, Table, section_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .study_figures import Across, Dot, Look, MarkRow, Scale, Stretch, rows_picture

_PAPER, _OURS = 0.2, -0.19  # above the middle of a row
_BAR = Stretch(0, 0, 0.25, 0.26, _OURS)
_THE_PAPER, _PREDICTED = Look(role="ink"), Look(shape="D", stroke="")
_ONE_SET, _MEDIAN = Look(shape="s", stroke="", filled=False, size=4.6), Look(shape="|", size=6)


def _sections(answer: Table2Study) -> Iterator[Section]:
    plans, paper = answer.plans, answer.paper
    caption = (
        "Standard deviation of one joint reading that would explain the paper’s; p-value of one for all"
        " offsets; whether a simulated set scatters as predicted"
    )
    heads = ["plan", "joint noise", "95 % interval", "p-value, one for all", "simulated set"]
    yield section_of(
        "The joint noise that would explain the scatter",
        blocks.table(caption, heads, plans, _overview, "lrrrl", tone=lambda plan: _verdict(plan).mark),
        *(Paragraph(_in_words(plan)) for plan in plans),
    )
    yield section_of(
        "Scatter of each offset",
        Paragraph(
            f"A standard deviation of {answer.settings.runs} runs determines the true one only to a wide"
            " interval: compare intervals, not dots. The prediction is for the joint noise above."
        ),
        FigureBlock("scatter"),
        *map(_scatter, plans),
    )
    notes = [Paragraph(sentence(one)) for one in paper.notes]
    yield section_of("What the paper prints", _paper(paper), *notes)


def _verdict(plan: Table2Plan) -> Cell:
    return Cell("no result", mark="weak") if plan.chi2 is None else blocks.standing(plan)


def _overview(plan: Table2Plan) -> blocks.Cells:
    p_value = blocks.NOT_GIVEN if plan.p_value is None else numbers.p_value(plan.p_value)
    interval = blocks.spread_range(plan.low, plan.high, "deg")
    return [blocks.name_of(plan), _joint_noise(plan), interval, p_value, _verdict(plan)]


def _in_words(plan: Table2Plan) -> str:
    """The plan's sentence, and how its simulated set compares with the prediction."""
    text = f"{blocks.plan_title(plan)}: {sentence(plan.sentence).rstrip('.')}."
    if plan.chi2 is None or plan.chance is None:
        return f"{text} A run of the simulated set has no result."
    return (
        f"{text} The simulated set: χ² {numbers.significant(plan.chi2)} for {plan.dof} degrees of"
        f" freedom, p {numbers.p_value(plan.chance)}."
    )


def _scatter(plan: Table2Plan) -> Table:
    heads = ["offset", "paper", "95 % of the true one", "predicted", "one simulated set"]
    heads += ["95 % of the sets", "joint noise required alone"]

    def cells(row: ScatterParameter) -> blocks.Cells:
        unit, sets = row.unit, row.simulated
        paper = [blocks.spread(row.paper_std, unit), blocks.spread_range(row.low, row.high, unit)]
        if not row.has_numbers:
            return [label(row.name), *paper, Cell(blocks.NOT_DETERMINED, span=4)]
        ours = [blocks.spread(row.predicted_std, unit), blocks.spread(row.simulated_std, unit)]
        between = blocks.NOT_GIVEN if sets is None else blocks.spread_range(sets.q2_5, sets.q97_5, unit)
        return [label(row.name), *paper, *ours, between, blocks.spread(row.alone_deg, "deg")]

    return blocks.table(
        f"{blocks.plan_title(plan)}: standard deviations over the runs of a set",
        heads,
        plan.parameters,
        cells,
        tone=lambda row: "" if row.has_numbers else "unidentifiable",
    )


def _paper(paper: PaperTable) -> Table:
    """The paper's table as it was printed, and what follows from its runs to as many decimals."""
    runs = [value for run in paper.experiments for value in run]
    rows = [(f"experiment {i}", run, runs) for i, run in enumerate(paper.experiments, start=1)]
    for name, printed, recomputed in (
        ("mean", paper.printed_mean, paper.mean),
        ("std", paper.printed_std, paper.std),
    ):
        rows += [(f"{name}, printed", printed, [*printed]), (f"{name}, recomputed", recomputed, [*printed])]

    def degrees(row: tuple[str, Sequence[float], Sequence[float]]) -> list[str]:
        """With the most decimals that any printed number has."""
        name, values, printed = row
        digits = max(len(f"{value:.10g}".partition(".")[2]) for value in printed)
        return [name, *(numbers.with_unit(numbers.fixed(value, digits), "deg") for value in values)]

    heads = ["", *map(label, paper.offsets)]
    return blocks.table("Joint offsets of three runs (Table 2)", heads, rows, degrees)


def _joint_noise(plan: Table2Plan) -> str:
    """The joint noise that explains the scatter, rounded by its own interval."""
    at, low, high = plan.joint_deg, plan.low, plan.high
    if at is None:
        return blocks.NOT_GIVEN
    if low is None or high is None or high <= low:
        return numbers.significant(at, 2, "deg")
    return numbers.estimate(at, (high - low) / (2 * NORMAL_95), "deg")


def _drawn(answer: Table2Study) -> list[Picture | None]:
    """Logarithmic; rows are the offsets of each plan: above the paper's std with its interval, below ours."""
    rows, every = list[MarkRow](), [row for plan in answer.plans for row in plan.parameters]
    for plan in answer.plans:
        rows.append(MarkRow(f"plan {clipped(plan.name, 30)}, joint noise {_joint_noise(plan)}", head=True))
        rows += map(_row, plan.parameters)
    if not any(row.paper_std for row in every):
        return [None]
    units = ", ".join(dict.fromkeys(numbers.symbol(row.unit) for row in every))
    return [
        rows_picture(
            "scatter",
            "Standard deviation of each offset over three runs: the paper’s, and what the noise predicts",
            "Standard deviations of the offsets.",
            rows,
            [Across(f"standard deviation, {units}", Scale(log=True))],
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
    paper, between = blocks.spread(row.paper_std, row.unit), blocks.spread_range(row.low, row.high, row.unit)
    predicted = f"predicted {blocks.spread(row.predicted_std, row.unit)}"
    gap = "" if row.has_numbers else blocks.NOT_DETERMINED
    if row.paper_std:
        marks.append(Dot(row.paper_std, row.low, row.high, _THE_PAPER, paper, up=_PAPER))
    if row.simulated is not None:
        marks.append(replace(_BAR, low=row.simulated.q2_5, high=row.simulated.q97_5))
        marks.append(Dot(row.simulated.median, look=_MEDIAN, up=_OURS))
    for at, look in ((row.predicted_std, _PREDICTED), (row.simulated_std, _ONE_SET)):
        marks += [Dot(at, look=look, up=_OURS)] if at else []
    return MarkRow(label(row.name, 9), [marks], gap, words=f"paper {paper} ({between}), {gap or predicted}")


def _offsets(answer: Any) -> Iterator[object]:
    """Of each offset of the paper's table its name, its runs, mean and std, degrees."""
    paper = answer.paper
    columns = (*paper.experiments, paper.mean, paper.std, paper.printed_mean, paper.printed_std)
    return zip(paper.offsets, *columns, strict=True)


TABLE2 = blocks.Study[Table2Study](
    subtitle=lambda answer: (
        f"the paper’s Table 2 against {answer.settings.simulated} simulated sets of"
        f" {answer.settings.runs} runs"
    ),
    sections=_sections,
    drawn=_drawn,
    details=lambda answer: [
        blocks.plans_in_words(answer.plans, lambda plan: f"spot {numbers.exact(plan.spot_mm, 'mm')}")
    ],
    hold="scatter.csv, plans.csv and paper.csv hold the standard deviations, the joint noise and the paper’s"
    " table",
    tables={
        "scatter.csv": blocks.flat(
            "plans parameters",
            "plan=1.name parameter=2.name unit status paper_std low high predicted_std alone_deg"
            " simulated_std simulated_q2_5=2.simulated.q2_5 simulated_median=2.simulated.median"
            " simulated_q97_5=2.simulated.q97_5",
        ),
        "plans.csv": blocks.flat(
            "plans", "plan=1.name shots spot_mm joint_deg low high p_value agrees chi2 dof chance"
        ),
        "paper.csv": blocks.flat(
            "",
            "parameter=1.0 experiment_1=1.1 experiment_2=1.2 experiment_3=1.3 mean=1.4 std=1.5"
            " printed_mean=1.6 printed_std=1.7",
            _offsets,
        ),
    },
)
