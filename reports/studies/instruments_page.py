"""The study `instruments`: uncertainty against number, time and cost of every setup."""

from __future__ import annotations

from ...analysis.tcp_region import region_of
from ...experiments.studies.instrument_choice import InstrumentsStudy, SetupCase, SetupPlan
from ...model.files.stated_workspace import CENTRAL_RANGES
from ...words import numbers
from ...words.region_words import region_words
from ...words.wording import label
from ..style.blocks import FigureBlock, Paragraph, Section, section_of
from ..style.canvas import Picture
from .study_blocks import NOT_GIVEN, Study, flat, settings_facts, table
from .study_figures import Curve, CurvePanel, Look, Scale, curves_picture

_COLUMNS = ("setup", "cost class", "measurements", "minutes", "largest u", "of", "TCP, mm", "not determined")
_LINES = ("identified", "weak", "unidentifiable", "ink", "muted")
_STROKES = ("-", "--", ":")
_MARKS = {1: "o", 2: "s", 3: "^", 4: "D"}  # by class of cost
_AXES = (("measurements", "number of measurements"), ("minutes", "minutes"))
_HEIGHTS = (("worst_u", "largest u of an offset, °"), ("tcp_mm", "TCP error, mm (rms)"))


def _sections(answer: InstrumentsStudy) -> list[Section]:
    every = [(case, plan) for case in answer.setups for plan in case.plans]
    section = section_of(
        "Uncertainty against number, time and cost",
        FigureBlock("instruments"),
        table(
            "The best plan of each number of measurements",
            _COLUMNS,
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
    sections=_sections,
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
