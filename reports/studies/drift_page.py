"""The page of the study `drift`: intervals, false alarms, the power of the test for jumps."""

from __future__ import annotations

from ...experiments.studies.drift_coverage import DriftStudy
from ...words import numbers
from ..style.blocks import FigureBlock, Page, Paragraph, row_of, section_of, table_of
from ..style.canvas import Picture
from . import study_blocks as blocks
from .study_figures import Curve, CurvePanel, Look, Scale, curves_picture

POWER = blocks.flat("power", "size_u found of share low high")


def drift_page(answer: DriftStudy) -> Page:
    """The display strings of the study of drift."""
    settings, alarms = answer.settings, answer.alarms
    intervals = []
    for name, held, control in (
        ("random combination", answer.intervals, False),
        ("worst determined", answer.along_axis, False),
        ("correlations ignored", answer.control, True),
    ):
        words = blocks.standing(held, control=control)[1]
        intervals.append(
            row_of(name, blocks.share(held), blocks.share_interval(held.low, held.high, held.of), words)
        )
    power = [
        row_of(
            f"{one.size_u:g} u",
            f"{one.found} of {one.of}",
            blocks.share(one),
            blocks.share_interval(one.low, one.high, one.of),
        )
        for one in answer.power
    ]
    sections = [
        section_of(
            "Intervals",
            table_of(
                f"Intervals of {blocks.percent(settings.level)} that hold the true value",
                ("combination of offsets", "share that holds, %", "95 % interval", "as it must be"),
                intervals,
                "lrrl",
            ),
            Paragraph(
                "Of each arm at one random result. The worst determined combination is the first principal"
                " axis of the plan’s correlations; the control takes a result’s offsets as uncorrelated."
            ),
        ),
        section_of(
            "False alarms",
            Paragraph(
                f"{alarms.alarms} of {alarms.arms} arms without a jump have an alarm:"
                f" {blocks.share_text(alarms.share, alarms.low, alarms.high, alarms.arms)} %; stated is"
                f" at most {blocks.percent(settings.alarm)}. The p-values of single tests are uniform: p"
                f" {numbers.p_value(alarms.p_uniform)}."
            ),
        ),
        section_of(
            "Jumps that are found",
            table_of(
                "Jumps found at their offset and interval; u is the standard uncertainty of the plan",
                ("size of the jump", "found", "share, %", "95 % interval"),
                power,
                "r",
            ),
            FigureBlock("power"),
        ),
    ]
    subtitle = f"{settings.arms} simulated arms of {settings.results} results"
    return blocks.view_of(
        answer, subtitle, sections, "power.csv holds the jumps that were found", by_the_paper=False
    )


def drift_pictures(answer: DriftStudy) -> list[Picture | None]:
    """The power curve."""
    power = answer.power
    if not power:
        return [None]
    low, high, shares = ([getattr(row, key) for row in power] for key in ("low", "high", "share"))
    curve = Curve([row.size_u for row in power], shares, "", Look(width=1.0), low, high)
    axes = ("size of the jump, in standard uncertainties u of the plan", "share found")
    panel = CurvePanel(
        [curve], Scale(ends=(-0.03, 1.03)), across=axes[0], up=axes[1], limit=answer.settings.alarm
    )
    alt = "; ".join(f"{row.size_u:g} u: {blocks.share(row)} %" for row in power)
    title = "Share of the jumps that are found, by size (bars: 95 % intervals; dashed: stated false alarms)"
    return [curves_picture("power", title, f"Share of jumps found. {alt}.", [panel], Scale())]
