"""The page of the study `instruments`: uncertainty against number, time and cost of every setup."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...analysis.tcp_region import region_of
from ...experiments.studies.instrument_choice import InstrumentsStudy, SetupCase, SetupPlan
from ...model.files.stated_workspace import CENTRAL_RANGES
from ...words import numbers
from ...words.region_words import region_words
from ...words.wording import label
from ..style.blocks import FigureBlock, Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture, new_figure, set_log_scale, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .study_blocks import NOT_GIVEN, PlainRow, columns_of, how_it_was_done, view_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMNS = ("setup", "cost class", "measurements", "minutes", "largest u", "of", "TCP, mm", "not determined")
_LINES = ("identified", "weak", "unidentifiable", "ink", "muted")
_STROKES = ("-", "--", ":")
_MARKS = {1: "o", 2: "s", 3: "^", 4: "D"}  # by class of cost
_AXES = (("measurements", "number of measurements"), ("minutes", "minutes"))
_HEIGHTS = (("worst_u", "largest u of an offset, °"), ("tcp_mm", "TCP error, mm (rms)"))


def instruments_page(answer: InstrumentsStudy) -> Page:
    """The display strings of the study of instruments."""
    settings = answer.settings
    sections = [
        section_of(
            "Uncertainty against number, time and cost",
            FigureBlock("instruments"),
            _table(answer),
            Paragraph(
                "Cost classes: 1 below 1,000, 2 below 10,000, 3 below 50,000, 4 above (EUR). Minutes contain"
                " the travel at full joint speed. There is no number where an offset is not determined."
            ),
        ),
        how_it_was_done(
            answer,
            [
                ("Robot", settings.robot),
                ("Noise of the joints", numbers.exact(settings.joint_deg, "°")),
                ("TCP in the flange frame", ", ".join(map(numbers.exact, settings.tcp_mm)) + " mm"),
                ("TCP error", region_words(region_of(CENTRAL_RANGES))),
                ("Candidate postures of each setup", str(settings.candidates)),
                ("Seed", str(settings.seed)),
            ],
            "plans.csv holds all plans",
        ),
    ]
    subtitle = f"{len(answer.setups)} setups on {settings.robot}, seed {settings.seed}"
    return view_of(answer, subtitle, sections, simulated=False)


def _table(answer: InstrumentsStudy) -> Table:
    rows = []
    for case in answer.setups:
        for k, plan in enumerate(case.plans):
            tone = "weak" if plan.undetermined else ""
            rows.append(row_of(*_cells(case, plan, first=k == 0), tone=tone))
    return table_of("The best plan of each number of measurements", _COLUMNS, rows, "lrrrrrrl")


def _cells(case: SetupCase, plan: SetupPlan, *, first: bool) -> tuple[str, ...]:
    parts = ", ".join(f"{count} {name}" for name, count in plan.by_instrument.items())
    return (
        case.name if first else "",
        str(case.cost) if first else "",
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
    with style():
        figure = new_figure(5.6)
        panels = figure.subplots(2, 2, sharex="col", sharey="row")
        for row, (height, title) in zip(panels, _HEIGHTS, strict=True):
            for axes, (along, name) in zip(row, _AXES, strict=True):
                _panel(axes, answer, along, height)
                if height == _HEIGHTS[-1][0]:
                    axes.set_xlabel(in_font(name))
            row[0].set_ylabel(in_font(title))
        handles, names = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2, fontsize=8.5, frameon=False)
        svg = to_svg(figure, "instruments")
    title = (
        "Largest uncertainty of an offset and error of the TCP, by number and by minutes (marks: cost class"
        " 1 ●, 2 ■, 3 ▲, 4 ◆)"
    )
    return [Picture("instruments", title, _alt(answer), svg)]


def _panel(axes: Axes, answer: InstrumentsStudy, along: str, height: str) -> None:
    points: list[tuple[float, float]] = []
    for k, case in enumerate(answer.setups):
        line = [
            (float(getattr(plan, along)), float(getattr(plan, height)))
            for plan in case.plans
            if getattr(plan, height) is not None
        ]
        points += line
        axes.plot(
            [x for x, _ in line],
            [y for _, y in line],
            _STROKES[k // len(_LINES) % len(_STROKES)],
            marker=_MARKS[case.cost],
            color=light(_LINES[k % len(_LINES)]),
            markersize=4.2,
            linewidth=1.3,
            label=in_font(case.name if line else f"{case.name} (not determined)"),
        )
    if points:
        for which, values in zip("xy", zip(*points, strict=True), strict=True):
            set_log_scale(axes, which, min(values) / 1.2, max(values) * 1.2)


def _alt(answer: InstrumentsStudy) -> str:
    parts = []
    for case in answer.setups:
        plan = case.plans[-1]
        known = plan.worst_u is not None
        words = numbers.spread(plan.worst_u or 0.0, "deg") if known else "offsets not determined"
        parts.append(f"{case.name}: {words} with {plan.measurements} measurements")
    return f"Largest uncertainty of an offset. {'; '.join(parts)}."


def setup_rows(answer: InstrumentsStudy) -> Iterator[PlainRow]:
    """`plans.csv`: a row for each setup and number of measurements."""
    for case in answer.setups:
        for plan in case.plans:
            yield {
                "setup": case.name,
                "cost": case.cost,
                **columns_of(plan, "measurements", "minutes", "worst_u", "worst", "tcp_mm", "efficiency"),
                "undetermined": " ".join(plan.undetermined),
            }
