"""The page of the study `drift`: intervals, false alarms, the power of the test for jumps."""

from __future__ import annotations

from collections.abc import Iterator

from ...experiments.studies.drift_coverage import DriftStudy, Power
from ...words import numbers
from ..style.blocks import FigureBlock, Page, Paragraph, Table, row_of, section_of, table_of
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .study_blocks import (
    STANDING,
    PlainRow,
    columns_of,
    how_it_was_done,
    percent,
    share,
    share_interval,
    share_text,
    view_of,
)


def drift_page(answer: DriftStudy) -> Page:
    """The display strings of the study of drift."""
    settings, alarms = answer.settings, answer.alarms
    sections = [
        section_of(
            "Intervals",
            _intervals(answer),
            Paragraph(
                "Of each arm at one random result. The worst determined combination is the first principal"
                " axis of the plan’s correlations; the control takes a result’s offsets as uncorrelated."
            ),
        ),
        section_of(
            "False alarms",
            Paragraph(
                f"{alarms.alarms} of {alarms.arms} arms without a jump have an alarm:"
                f" {share_text(alarms.share, alarms.low, alarms.high, alarms.arms)} %; stated is at most"
                f" {percent(settings.alarm)}. The p-values of single tests are uniform: p"
                f" {numbers.p_value(alarms.p_uniform)}."
            ),
        ),
        section_of("Jumps that are found", _power(answer), FigureBlock("power")),
        how_it_was_done(
            answer,
            [
                ("Arms", str(settings.arms)),
                ("Results of an arm", f"{settings.results}, every {settings.years_between:g} years"),
                (
                    "Drift rate of an offset",
                    f"log-normal: median {settings.rate_median:g}° per root year, standard deviation"
                    f" {settings.rate_spread:g} of its logarithm",
                ),
                ("Seed", str(settings.seed)),
            ],
            "power.csv holds the jumps that were found",
        ),
    ]
    subtitle = f"{settings.arms} simulated arms of {settings.results} results, seed {settings.seed}"
    return view_of(answer, subtitle, sections)


def _intervals(answer: DriftStudy) -> Table:
    heads = ("combination of offsets", "share that holds, %", "95 % interval", "as it must be")
    rows = []
    for name, held, control in (
        ("random combination", answer.intervals, False),
        ("worst determined", answer.along_axis, False),
        ("correlations ignored", answer.control, True),
    ):
        _, words = STANDING[control, held.agrees]
        rows.append(row_of(name, share(held), share_interval(held.low, held.high, held.of), words))
    return table_of(
        f"Intervals of {percent(answer.settings.level)} that hold the true value", heads, rows, "lrrl"
    )


def _power(answer: DriftStudy) -> Table:
    heads = ("size of the jump", "found", "share, %", "95 % interval")
    rows = []
    for row in answer.power:
        interval = share_interval(row.low, row.high, row.of)
        rows.append(row_of(f"{row.size_u:g} u", f"{row.found} of {row.of}", _share(row), interval))
    caption = "Jumps found at their offset and interval; u is the standard uncertainty of the plan"
    return table_of(caption, heads, rows, "r")


def _share(row: Power) -> str:
    return share_text(row.share, row.low, row.high, row.of).partition(" ")[0]


def drift_pictures(answer: DriftStudy) -> list[Picture | None]:
    """The power curve."""
    power = answer.power
    if not power:
        return [None]
    with style():
        figure = new_figure(2.6)
        axes = figure.subplots()
        sizes, blue = [row.size_u for row in power], light("identified")
        for row in power:
            axes.plot([row.size_u] * 2, [row.low, row.high], "-", linewidth=1.3, color=blue)
        axes.plot(sizes, [row.share for row in power], "o-", markersize=4.2, linewidth=1, color=blue)
        axes.axhline(answer.settings.alarm, color=light("muted"), linewidth=0.8, linestyle="--")
        axes.set_ylim(-0.03, 1.03)
        axes.set_xlabel(in_font("size of the jump, in standard uncertainties u of the plan"))
        axes.set_ylabel(in_font("share found"))
        svg = to_svg(figure, "power")
    alt = "; ".join(f"{row.size_u:g} u: {_share(row)} %" for row in power)
    title = "Share of the jumps that are found, by size (bars: 95 % intervals; dashed: stated false alarms)"
    return [Picture("power", title, f"Share of jumps found. {alt}.", svg)]


def power_rows(answer: DriftStudy) -> Iterator[PlainRow]:
    """`power.csv`: a row for each size of jump."""
    for row in answer.power:
        yield columns_of(row, "size_u", "found", "of", "share", "low", "high")
