"""The page of the study `instruments`: uncertainty against number, time and cost of every setup."""

from __future__ import annotations

from ...analysis.tcp_region import region_of
from ...experiments.studies.instrument_choice import InstrumentsStudy, SetupCase, SetupPlan
from ...model.files.stated_workspace import CENTRAL_RANGES
from ...words import numbers
from ...words.region_words import region_words
from ...words.wording import label
from ..style.blocks import FigureBlock, Page, Paragraph, row_of, section_of, table_of
from ..style.canvas import Picture
from .study_blocks import NOT_GIVEN, flat, settings_facts, view_of
from .study_figures import Curve, CurvePanel, Look, Scale, curves_picture

_COLUMNS = ("setup", "cost class", "measurements", "minutes", "largest u", "of", "TCP, mm", "not determined")
_LINES = ("identified", "weak", "unidentifiable", "ink", "muted")
_STROKES = ("-", "--", ":")
_MARKS = {1: "o", 2: "s", 3: "^", 4: "D"}  # by class of cost
_AXES = (("measurements", "number of measurements"), ("minutes", "minutes"))
_HEIGHTS = (("worst_u", "largest u of an offset, °"), ("tcp_mm", "TCP error, mm (rms)"))

SETUPS = flat(
    "setups plans",
    "setup=1.name cost=1.cost measurements minutes worst_u worst tcp_mm efficiency undetermined",
)


def instruments_page(answer: InstrumentsStudy) -> Page:
    """The display strings of the study of instruments."""
    rows = [
        row_of(*_cells(case, plan, first=k == 0), tone="weak" if plan.undetermined else "")
        for case in answer.setups
        for k, plan in enumerate(case.plans)
    ]
    section = section_of(
        "Uncertainty against number, time and cost",
        FigureBlock("instruments"),
        table_of("The best plan of each number of measurements", _COLUMNS, rows, "lrrrrrrl"),
        Paragraph(
            "Cost classes: 1 below 1,000, 2 below 10,000, 3 below 50,000, 4 above (EUR). Minutes contain"
            " the travel at full joint speed. There is no number where an offset is not determined."
        ),
    )
    return view_of(
        answer,
        f"{len(answer.setups)} setups on {answer.settings.robot}",
        [section],
        "plans.csv holds all plans",
        simulated=False,
        by_the_paper=False,
        settings=[*settings_facts(answer), ("TCP error", region_words(region_of(CENTRAL_RANGES)))],
    )


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
    log = Scale(log=True)
    panels = [
        CurvePanel(
            [_curve(k, case, along, height) for k, case in enumerate(answer.setups)], log, "", "", name, title
        )
        for height, title in _HEIGHTS
        for along, name in _AXES
    ]
    parts = []
    for case in answer.setups:
        plan = case.plans[-1]
        known = plan.worst_u is not None
        words = numbers.spread(plan.worst_u or 0.0, "deg") if known else "offsets not determined"
        parts.append(f"{case.name}: {words} with {plan.measurements} measurements")
    title = (
        "Largest uncertainty of an offset and error of the TCP, by number and by minutes (marks: cost class"
        " 1 ●, 2 ■, 3 ▲, 4 ◆)"
    )
    alt = f"Largest uncertainty of an offset. {'; '.join(parts)}."
    return [curves_picture("instruments", title, alt, panels, log, wide=2, panel_height=2.4)]


def _curve(k: int, case: SetupCase, along: str, height: str) -> Curve:
    points = [(getattr(plan, along), getattr(plan, height)) for plan in case.plans]
    known = [(x, y) for x, y in points if y is not None]
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
