"""The pages of the studies of drift, instruments, wrong models and Table 2; and of which kind a folder of
each study is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...analysis.tcp_region import region_of
from ...experiments.studies.answer import SCHEMA, StudyAnswer
from ...experiments.studies.drift_coverage import DriftStudy
from ...experiments.studies.instrument_choice import InstrumentsStudy, SetupCase, SetupPlan
from ...experiments.studies.sweeps.grid_answer import GridStudy
from ...experiments.studies.table2 import PaperTable, ScatterParameter, Table2Plan, Table2Study
from ...experiments.studies.wrong_models import WrongModel, WrongModelsStudy
from ...model.arrays import NORMAL_95
from ...model.files.stated_workspace import CENTRAL_RANGES
from ...model.records import to_json
from ...words import numbers
from ...words.outlook_words import region_words
from ...words.wording import clipped, label, sentence
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from ..style.blocks import Cell, FigureBlock, Page, Paragraph, Section, Table, section_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .interval_pages import CELL, COVERAGE, GEOMETRY
from .study_blocks import NOT_GIVEN, Study, flat, settings_facts, table
from .study_figures import (
    Across,
    Curve,
    CurvePanel,
    Dot,
    Look,
    MarkRow,
    Scale,
    Stretch,
    curves_picture,
    rows_picture,
)
from .sweep_page import SWEEP


def _drift_sections(answer: DriftStudy) -> Iterator[Section]:
    settings, alarms = answer.settings, answer.alarms

    def shares(of: tuple[str, Any, bool]) -> blocks.Cells:
        name, held, control = of
        words = blocks.standing(held, control=control).text
        return [name, blocks.share(held), blocks.share_interval(held.low, held.high, held.of), words]

    def jumps(one: Any) -> blocks.Cells:
        return [
            f"{one.size_u:g} u",
            f"{one.found} of {one.of}",
            blocks.share(one),
            blocks.share_interval(one.low, one.high, one.of),
        ]

    yield section_of(
        "Intervals",
        blocks.table(
            f"Intervals of {blocks.percent(settings.level)} that hold the true value",
            ("combination of offsets", "share that holds, %", "95 % interval", "as it must be"),
            [
                ("random combination", answer.intervals, False),
                ("worst determined", answer.along_axis, False),
                ("correlations ignored", answer.control, True),
            ],
            shares,
            "lrrl",
        ),
        Paragraph(
            "Of each arm at one random result. The worst determined combination is the first principal"
            " axis of the plan’s correlations; the control takes a result’s offsets as uncorrelated."
        ),
    )
    yield section_of(
        "False alarms",
        Paragraph(
            f"{alarms.alarms} of {alarms.arms} arms without a jump have an alarm:"
            f" {blocks.share_text(alarms.share, alarms.low, alarms.high, alarms.arms)} %; stated is"
            f" at most {blocks.percent(settings.alarm)}. The p-values of single tests are uniform: p"
            f" {numbers.p_value(alarms.p_uniform)}."
        ),
    )
    heads = ("size of the jump", "found", "share, %", "95 % interval")
    caption = "Jumps found at their offset and interval; u is the standard uncertainty of the plan"
    table = blocks.table(caption, heads, answer.power, jumps, "r")
    yield section_of("Jumps that are found", table, FigureBlock("power"))


def _drift_drawn(answer: DriftStudy) -> list[Picture | None]:
    """The power curve."""
    if not answer.power:
        return [None]
    low, high, shares = ([getattr(row, key) for row in answer.power] for key in ("low", "high", "share"))
    curve = Curve([row.size_u for row in answer.power], shares, "", Look(width=1.0), low, high)
    panel = CurvePanel(
        [curve],
        Scale(ends=(-0.03, 1.03)),
        across="size of the jump, in standard uncertainties u of the plan",
        up="share found",
        limit=answer.settings.alarm,
    )
    title = "Share of the jumps that are found, by size (bars: 95 % intervals; dashed: stated false alarms)"
    return [curves_picture("power", title, "Share of jumps found by", [panel], Scale())]


DRIFT = blocks.Study[DriftStudy](
    subtitle=lambda answer: f"{answer.settings.arms} simulated arms of {answer.settings.results} results",
    sections=_drift_sections,
    drawn=_drift_drawn,
    hold="power.csv holds the jumps that were found",
    tables={"power.csv": blocks.flat("power", "size_u found of share low high")},
    by_the_paper=lambda answer: False,
)


_INSTRUMENT_COLUMNS = (
    "setup",
    "cost class",
    "measurements",
    "minutes",
    "largest u",
    "of",
    "TCP, mm",
    "not determined",
)
_LINES = ("identified", "weak", "unidentifiable", "ink", "muted")
_STROKES = ("-", "--", ":")
_MARKS = {1: "o", 2: "s", 3: "^", 4: "D"}  # by class of cost
_AXES = (("measurements", "number of measurements"), ("minutes", "minutes"))
_HEIGHTS = (("worst_u", "largest u of an offset, °"), ("tcp_mm", "TCP error, mm (rms)"))


def _instruments_sections(answer: InstrumentsStudy) -> list[Section]:
    every = [(case, plan) for case in answer.setups for plan in case.plans]
    section = section_of(
        "Uncertainty against number, time and cost",
        FigureBlock("instruments"),
        table(
            "The best plan of each number of measurements",
            _INSTRUMENT_COLUMNS,
            every,
            lambda of: _cells(*of),
            "lrrrrrrl",
            tone=lambda of: "weak" if of[1].undetermined else "",
        ),
        Paragraph(
            "Cost classes: 1 below 1,000, 2 below 10,000, 3 below 50,000, 4 above (EUR). Minutes contain"
            " the travel at full joint speed. There is no number where an offset is not determined."
        ),
    )
    return [section]


def _cells(case: SetupCase, plan: SetupPlan) -> tuple[str, ...]:
    parts = ", ".join(f"{count} {name}" for name, count in plan.by_instrument.items())
    return (
        *((case.name, str(case.cost)) if plan is case.plans[0] else ("", "")),
        str(plan.measurements) if len(plan.by_instrument) == 1 else f"{plan.measurements} ({parts})",
        numbers.significant(plan.minutes, 2),
        NOT_GIVEN if plan.worst_u is None else numbers.spread(plan.worst_u, "deg"),
        "" if plan.worst is None else label(plan.worst),
        NOT_GIVEN if plan.tcp_mm is None else numbers.spread(plan.tcp_mm),
        ", ".join(map(label, plan.undetermined)),
    )


def instruments_pictures(answer: InstrumentsStudy) -> list[Picture | None]:
    """One figure: u of the offsets and TCP error, against number and minutes."""
    if not any(plan.worst_u for case in answer.setups for plan in case.plans):
        return [None]
    panels = [
        CurvePanel(
            [_curve(k, case, along, height) for k, case in enumerate(answer.setups)],
            Scale(log=True),
            across=name,
            up=title,
        )
        for height, title in _HEIGHTS
        for along, name in _AXES
    ]
    title = (
        "Largest uncertainty of an offset and error of the TCP, by number and by minutes (marks: cost class"
        " 1 ●, 2 ■, 3 ▲, 4 ◆)"
    )
    about = "Largest uncertainty of an offset, °, and error of the TCP, mm."
    return [curves_picture("instruments", title, about, panels, Scale(log=True), wide=2, panel_height=2.4)]


def _curve(k: int, case: SetupCase, along: str, height: str) -> Curve:
    known = [(getattr(plan, along), y) for plan in case.plans if (y := getattr(plan, height)) is not None]
    return Curve(
        [x for x, _ in known],
        [y for _, y in known],
        case.name if any(plan.worst_u for plan in case.plans) else f"{case.name} (not determined)",
        Look(
            role=_LINES[k % len(_LINES)],
            stroke=_STROKES[k // len(_LINES) % len(_STROKES)],
            shape=_MARKS[case.cost],
        ),
    )


INSTRUMENTS = Study[InstrumentsStudy](
    subtitle=lambda answer: f"{len(answer.setups)} setups on {answer.settings.robot}",
    sections=_instruments_sections,
    drawn=instruments_pictures,
    settings=lambda answer: [*settings_facts(answer), ("TCP error", region_words(region_of(CENTRAL_RANGES)))],
    hold="plans.csv holds all plans",
    tables={
        "plans.csv": flat(
            "setups plans",
            "setup=1.name cost=1.cost measurements minutes worst_u worst tcp_mm efficiency undetermined",
        )
    },
    simulated=lambda answer: False,
    by_the_paper=lambda answer: False,
)


_MODEL_COLUMNS = (
    "what is wrong",
    "measurements",
    "passes",
    "misfits",
    "weakly observable",
    "rms error of passes, u",
    "largest error of a pass, u",
    "passes beyond 4 u",
    "of these without a warning",
    "right cause named first",
    "right of causes decided",
)
_BRIEF = (0, 1, 2, 3, 6, 7, 9)  # the columns of the docs


def cells(one: WrongModel) -> tuple[str, ...]:
    """A row of the table, also of docs/diagnosis.md."""
    return (
        one.scenario,
        *map(str, (one.measurements, one.passes, one.misfits, one.weak)),
        NOT_GIVEN if one.z is None else numbers.fixed(one.z, 2),
        NOT_GIVEN if one.largest_u is None else numbers.fixed(one.largest_u, 1),
        *map(str, (one.beyond, one.unsaid)),
        f"{one.named} of {one.misfits}" if one.nameable and one.misfits else NOT_GIVEN,
        f"{one.decided_right} of {one.decided}" if one.nameable and one.decided else NOT_GIVEN,
    )


def markdown(answer: WrongModelsStudy) -> str:
    """The table as docs/diagnosis.md has it, with fewer columns."""
    lines = [_MODEL_COLUMNS, ("---",) * len(_MODEL_COLUMNS), *map(cells, answer.models)]
    return "".join(f"| {' | '.join(line[k] for k in _BRIEF)} |\n" for line in lines)


def _models_sections(answer: WrongModelsStudy) -> list[Section]:
    settings = answer.settings
    about = (
        f"Of {settings.arms} arms each: how many pass, are a misfit, or neither. Of those that pass:"
        " the root mean square and the largest error of the offsets in their standard uncertainties"
        f" u, and how many have an offset beyond {settings.limit_u:g} u; how many of these"
        " do not name the wrong model among their conditions. Of the misfits: how many"
        " name the right cause first; and of those where the best cause has an evidence of more than"
        f" {settings.decided:g} times the next, how many are right."
    )
    counts = table(
        "Random arms with one thing wrong",
        _MODEL_COLUMNS,
        answer.models,
        cells,
        tone=lambda one: "" if one.holds else "weak",
    )
    return [section_of("Verdicts, errors and causes", Paragraph(about), counts)]


WRONG_MODELS = Study[WrongModelsStudy](
    subtitle=lambda answer: f"{answer.settings.arms} simulated arms for each scenario",
    sections=_models_sections,
    hold="models.csv holds the counts",
    tables={
        "models.csv": flat(
            "models",
            "scenario measurements arms passes misfits weak z largest_u beyond unsaid nameable noticeable"
            " named decided decided_right",
        )
    },
)


_PAPER, _OURS = 0.2, -0.19  # above the middle of a row
_BAR = Stretch(0, 0, 0.25, 0.26, _OURS)
_THE_PAPER, _PREDICTED = Look(role="ink"), Look(shape="D", stroke="")
_ONE_SET, _MEDIAN = Look(shape="s", stroke="", filled=False, size=4.6), Look(shape="|", size=6)


def _table2_sections(answer: Table2Study) -> Iterator[Section]:
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


def _table2_drawn(answer: Table2Study) -> list[Picture | None]:
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
    sections=_table2_sections,
    drawn=_table2_drawn,
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


# All but the studies over settings, which people write themselves, whatever their names.
STUDIES: dict[str, Study[Any]] = {
    "coverage": COVERAGE,
    "cell": CELL,
    "table2": TABLE2,
    "geometry": GEOMETRY,
    "drift": DRIFT,
    "instruments": INSTRUMENTS,
    "wrong-models": WRONG_MODELS,
}


def study_of(answer: StudyAnswer) -> Study[Any]:
    """The kind of an answer. Raises ValueError where it is of none."""
    study = SWEEP if isinstance(answer, GridStudy) else STUDIES.get(answer.study)
    if study is None:
        raise ValueError(f"a study is one of {', '.join(STUDIES)}, or over settings, not {answer.study!r}")
    return study


def study_of_file(content: object) -> Study[Any] | None:
    """The kind of the content of a study.json; None where it is of no known kind.

    A study over settings is known by its axes and cases, any other by its name.
    """
    if not isinstance(content, dict):
        return None
    if isinstance(content.get("axes"), list) and isinstance(content.get("cases"), list):
        return SWEEP
    return STUDIES.get(str(content.get("study")))


def study_page(answer: StudyAnswer) -> Page:
    """All that the page of a study says."""
    return study_of(answer).page(answer)


_JSON = "study.json"


def write_study(folder: Path | str, answer: StudyAnswer) -> Written:
    """Write a study (`zerobeam/study/1`) to `folder`. Raises as `write_answer`, and ValueError where `answer`
    holds a number that is not finite."""
    study = study_of(answer)
    tables = {name: rows(answer) for name, rows in study.tables.items()}
    contents = FolderContents(to_json(answer), study.page(answer), study.drawn(answer), tables)
    return write_answer(folder, study_kind(folder), contents)


def study_kind(folder: Path | str) -> Kind:
    """The files that may be replaced in `folder`: those of the study that is there, and of no other study.

    So a table of somebody's own is safe even if another study has one of that name.
    """
    try:
        study = study_of_file(json.loads((Path(folder) / _JSON).read_text(encoding="utf-8")))
    except (OSError, ValueError):
        study = None
    return Kind.of_answer("study", _JSON, SCHEMA, *(study.tables if study is not None else ()))
