"""The page of the study `table2`: the scatter of the paper's three runs against the predicted one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...experiments.studies.table2_answer import Paper, Table2Plan, Table2Study
from ...words import numbers
from ...words.wording import clipped, label, sentence
from ..style.blocks import Cell, Facts, FigureBlock, Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture
from .phrases import (
    LONGEST_NAME,
    NOT_DETERMINED,
    NOT_GIVEN,
    about_study,
    files_block,
    plan_in_words,
    plan_title,
    spread,
    spread_range,
    view_of,
)
from .scatter_figure import joint_noise, scatter_picture
from .shares import STANDING, PlainRow

_CLAIMED = ("predicted_std", "alone_deg", "simulated_std")


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
        section_of(
            "How it was done",
            about_study(
                answer,
                [
                    ("Runs in a set", str(settings.runs)),
                    ("Simulated sets", str(settings.simulated)),
                    ("Seed", str(settings.seed)),
                ],
            ),
            files_block(
                "scatter.csv, plans.csv and paper.csv hold the standard deviations, the joint noise and the"
                " paper’s table"
            ),
        ),
        section_of("Plans", Facts(_plans(plans)), level=2),
    ]
    return view_of(answer, f"the paper’s Table 2 against {triples}, seed {settings.seed}", sections)


def _overview(plans: Sequence[Table2Plan]) -> Table:
    columns = [
        ("plan", "left"),
        ("joint noise", "right"),
        ("95 % interval", "right"),
        ("p-value, one for all", "right"),
        ("simulated set", "left"),
    ]
    rows = [
        row_of(
            clipped(plan.name, LONGEST_NAME),
            joint_noise(plan),
            spread_range(plan.low, plan.high, "deg"),
            NOT_GIVEN if plan.p_value is None else numbers.p_value(plan.p_value),
            (fits := _as_predicted(plan)),
            tone=fits.mark,
        )
        for plan in plans
    ]
    caption = (
        "Standard deviation of one joint reading that would explain the paper’s; p-value of one for all"
        " offsets; whether a simulated set scatters as predicted"
    )
    return table_of(caption, columns, rows)


def _as_predicted(plan: Table2Plan) -> Cell:
    if plan.chi2 is None:
        return Cell("no result", mark="weak")
    mark, words = STANDING[False, plan.agrees]
    return Cell(words, mark=mark)


def _in_words(plan: Table2Plan) -> str:
    """The plan's sentence, and how its simulated set compares with the prediction."""
    said = f"{plan_title(plan.name)}: {sentence(plan.sentence).rstrip('.')}."
    if plan.chi2 is None or plan.chance is None:
        return f"{said} A run of the simulated set has no result."
    return (
        f"{said} The simulated set: χ² {numbers.significant(plan.chi2)} for {plan.dof} degrees of"
        f" freedom, p {numbers.p_value(plan.chance)}."
    )


def _scatter(plan: Table2Plan) -> Table:
    columns = [
        ("offset", "left"),
        ("paper", "right"),
        ("95 % of the true one", "right"),
        ("predicted", "right"),
        ("one simulated set", "right"),
        ("95 % of the sets", "right"),
        ("joint noise required alone", "right"),
    ]
    rows = []
    for row in plan.parameters:
        name, unit = label(row.name), row.unit
        paper = [spread(row.paper_std, unit), spread_range(row.low, row.high, unit)]
        if not row.is_known:
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


def _paper(paper: Paper) -> Table:
    """The paper's table as it was printed, and what follows from its runs to as many decimals."""
    columns = [("", "left"), *((label(name), "right") for name in paper.offsets)]
    stated = [value for run in paper.experiments for value in run]
    rows = [
        row_of(f"experiment {i}", *_degrees(run, stated)) for i, run in enumerate(paper.experiments, start=1)
    ]
    for name, printed, own in (
        ("mean", paper.printed_mean, paper.mean),
        ("std", paper.printed_std, paper.std),
    ):
        for words, values in ((f"{name}, printed", printed), (f"{name}, recomputed", own)):
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


def table2_pictures(answer: Table2Study) -> list[Picture | None]:
    return [scatter_picture(answer.plans)]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def scatter_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each plan and offset; of the paper only where the plan does not determine the offset."""
    for plan in answer.plans:
        for row in plan.parameters:
            yield {
                "plan": plan.name,
                "parameter": row.name,
                **{key: getattr(row, key) for key in ("unit", "status", "paper_std", "low", "high")},
                **{key: getattr(row, key) for key in _CLAIMED},
                **{
                    f"simulated_{key}": getattr(row.simulated, key, None)
                    for key in ("q2_5", "median", "q97_5")
                },
            }


def plan_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each plan."""
    for plan in answer.plans:
        keys = ("shots", "spot_mm", "joint_deg", "low", "high", "p_value", "agrees", "chi2", "dof", "chance")
        yield {"plan": plan.name, **{key: getattr(plan, key) for key in keys}}


def paper_rows(answer: Table2Study) -> Iterator[PlainRow]:
    """One row for each offset of the paper's table, degrees."""
    paper = answer.paper
    for i, name in enumerate(paper.offsets):
        yield {
            "parameter": name,
            **{f"experiment_{k}": run[i] for k, run in enumerate(paper.experiments, start=1)},
            **{key: getattr(paper, key)[i] for key in ("mean", "std", "printed_mean", "printed_std")},
        }
