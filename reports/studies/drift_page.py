"""The study `drift`: intervals, false alarms, the power of the test for jumps."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...experiments.studies.drift_coverage import DriftStudy
from ...words import numbers
from ..style.blocks import FigureBlock, Paragraph, Section, section_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .study_figures import Curve, CurvePanel, Look, Scale, curves_picture


def _sections(answer: DriftStudy) -> Iterator[Section]:
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


def _drawn(answer: DriftStudy) -> list[Picture | None]:
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
    sections=_sections,
    drawn=_drawn,
    hold="power.csv holds the jumps that were found",
    tables={"power.csv": blocks.flat("power", "size_u found of share low high")},
    by_the_paper=lambda answer: False,
)
