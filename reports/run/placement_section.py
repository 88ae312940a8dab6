"""Placements predicted by the others, the jackknife; correlation and steps of recordings; runs held out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...analysis.answer.result import Result
from ...analysis.diagnostics.hold_out import Jackknife, LeaveOneOut
from ...analysis.recordings.recordings import Effective
from ...analysis.recordings.steps import RecordingStep
from ...analysis.status import LACK_OF_FIT
from ...words import numbers
from ...words.misfit_words import step_sentence
from ...words.wording import clipped, counted, label, listed, shown
from ..style.blocks import FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.theme import in_font, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
from typing import TYPE_CHECKING

from ...analysis.prediction import PredictedRun
from ...words.finding_words import predicted_run_alt, predicted_run_sentences
from ..style.blocks import Facts

if TYPE_CHECKING:
    from matplotlib.axes import Axes


_NAME = 24
_PICTURE = "placements"
_MOST_BARS = 40


def placements_section(result: Result) -> Section | None:
    """None where there is one placement and no recording long enough to say anything."""
    placements = result.placements
    jackknife = placements.jackknife if result.misfit is None else None
    sentences = [
        text
        for text in (
            *_left_out_sentences(placements.leave_one_out),
            _jackknife_sentence(result, jackknife),
            _effective_sentence(placements.effective, result),
            *map(_step_text, placements.steps.rows),
        )
        if text
    ]
    if not sentences:
        return None
    return section_of(
        "Placements and recordings",
        *map(Paragraph, sentences),
        None if placements.leave_one_out is None else FigureBlock(_PICTURE),
        None if placements.leave_one_out is None else _left_out_table(placements.leave_one_out),
        None if jackknife is None else _jackknife_table(result, jackknife),
    )


def placements_lines(result: Result) -> list[str]:
    """What the terminal says of them, a line each."""
    placements = result.placements
    lines = []
    if placements.leave_one_out is not None and placements.leave_one_out.rms_mm is not None:
        lines.append(_pooled(placements.leave_one_out))
    if placements.effective.divisor > 1:
        lines.append(_effective_sentence(placements.effective, result))
    return lines


def _pooled(held_out: LeaveOneOut) -> str:
    off = [
        row.placements[0] for row in held_out.rows if row.p_value is not None and row.p_value < LACK_OF_FIT
    ]
    text = (
        f"Each of {counted(len(held_out.rows), 'placement')} as the others predict it: residuals"
        f" {numbers.or_words(held_out.rms_mm, 'not available', 'mm')} rms, expected from noise and fit"
        f" {numbers.or_words(held_out.expected_mm, 'not available', 'mm')}."
    )
    if off:
        text += f" Beyond noise and fit (p < {LACK_OF_FIT:g}): {listed([clipped(n, _NAME) for n in off])}."
    return text


def _left_out_sentences(held_out: LeaveOneOut | None) -> list[str]:
    if held_out is None:
        return []
    return [
        _pooled(held_out)
        + " For each row offsets and tool come from the other placements; only its own targets are"
        " fitted to it. The factor is the root of χ² over its degrees of freedom."
    ]


def _left_out_table(held_out: LeaveOneOut) -> Table:
    columns = ["placement", "measurements", "residual, rms", "expected", "factor", "p-value"]
    missing = "not available"
    rows = [
        row_of(
            clipped(row.placements[0], _NAME),
            str(row.shots),
            numbers.or_words(row.rms_mm, missing, "mm"),
            numbers.or_words(row.expected_mm, missing, "mm"),
            numbers.or_words(row.factor, missing),
            missing if row.p_value is None else numbers.p_value(row.p_value),
        )
        for row in held_out.rows
    ]
    return table_of("Each placement as the others predict it", columns, rows)


def _jackknife_sentence(result: Result, jackknife: Jackknife | None) -> str:
    if jackknife is None or not jackknife.offsets:
        return ""
    larger = [
        row.name
        for row in jackknife.offsets
        if row.u is not None and row.u > 2 * (result.parameters.named(row.name).std or row.u)
    ]
    text = (
        f"The jackknife takes the uncertainty of an offset from the scatter of its estimates without"
        f" one placement, not from the stated noise. It has {jackknife.dof} degrees of freedom, and"
        " does not see an error that all placements share."
    )
    if larger:
        text += f" It is more than twice as large for {listed([label(name) for name in larger])}."
    return text


def _jackknife_table(result: Result, jackknife: Jackknife) -> Table | None:
    columns = ["name", "U", "U by jackknife", "not determined without"]
    k, rows = result.coverage_factor, []
    for row in jackknife.offsets:
        std = result.parameters.named(row.name).std
        rows.append(
            row_of(
                label(row.name),
                "—" if std is None else numbers.spread(k * std, row.unit),
                _scatter(row.u, k, row.unit),
                listed([clipped(name, _NAME) for name in row.needs]) if row.needs else "",
            )
        )
    return table_of("Offsets by the delete-one-placement jackknife", columns, rows, "lrrl") if rows else None


def _scatter(u: float | None, k: float, unit: str) -> str:
    """U by the jackknife: nothing scatters where placements are copies of each other."""
    if u is None:
        return "none"
    return numbers.spread(k * u, unit) if u > 0 else numbers.with_unit("0", unit)


def _effective_sentence(effective: Effective, result: Result) -> str:
    if effective.p_value is None:
        return ""
    size = "undetermined" if effective.rho is None else numbers.fixed(effective.rho, 2)
    measure = f"lag-1 correlation {size}, p {numbers.p_value(effective.p_value)}"
    if effective.divisor == 1:
        return f"Successive residuals of a recording are not significantly correlated ({measure})."
    used = "their information is divided by κ"
    if result.misfit is not None and result.geometry.tolerance is None:
        used = "a misfit by nominal geometry is left as it is"
    return (
        f"Successive residuals of a recording are correlated ({measure}):"
        f" {counted(effective.shots, 'measurement')} are worth"
        f" {numbers.significant(effective.number, 2)} independent ones"
        f" (κ = {numbers.significant(effective.divisor, 2)}); {used}."
    )


def _step_text(step: RecordingStep) -> str:
    return f"{step_sentence(step)}."


def placements_picture(result: Result) -> Picture | None:
    """The residual at each placement that the others predict, dots, and what is expected, ticks."""
    held_out = result.placements.leave_one_out
    if held_out is None:
        return None
    rows = [row for row in held_out.rows if row.rms_mm is not None][:_MOST_BARS]
    if not rows:
        return None
    with style():
        figure = new_figure(2.6)
        axes: Axes = figure.subplots()
        x = np.arange(len(rows))
        residuals = np.array([row.rms_mm for row in rows], dtype=float)
        expected = np.array([row.expected_mm for row in rows], dtype=float)
        axes.vlines(x, 0, residuals, color=light("line"), linewidth=1)
        axes.plot(x, expected, "_", markersize=16, markeredgewidth=1.5, color=light("weak"), label="expected")
        axes.plot(
            x,
            residuals,
            "o",
            markersize=5,
            markeredgewidth=0,
            color=light("identified"),
            label="residual, rms",
        )
        axes.set_ylabel("residual, mm rms")
        axes.set_ylim(bottom=0)
        axes.set_xlim(-0.6, len(rows) - 0.4)
        axes.set_xticks(x, [clipped(in_font(shown(row.placements[0])), 14) for row in rows])
        axes.tick_params(axis="x", labelsize=8, rotation=30 if len(rows) > 5 else 0)
        axes.grid(visible=False, axis="x")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, frameon=False, fontsize=8.5)
        svg = to_svg(figure, _PICTURE)
    worst = max(rows, key=lambda row: row.rms_mm or 0.0)
    alt = (
        f"Residuals at {counted(len(rows), 'placement')} that the fit had not seen, against what noise and"
        f" fit explain; the largest is {numbers.or_words(worst.rms_mm, '', 'mm')} at {worst.placements[0]}."
    )
    return Picture(_PICTURE, "Each placement as the others predict it", alt, svg)


_RUN_PICTURE = "held_out_run"
_MOST_ROWS = 20
_MOST_DRAWN = 1000
_MISSING = "not available"


def predicted_run_section(result: Result) -> Section | None:
    """None where no run was held out."""
    run = result.hold_out
    if not isinstance(run, PredictedRun):
        return None
    predicted = run.rms_mm is not None
    return section_of(
        "Held-out run",
        *map(Paragraph, predicted_run_sentences(run)),
        FigureBlock(_RUN_PICTURE) if predicted else None,
        Facts(_facts(run)),
        _errors_table(run) if run.measurements else None,
    )


def _facts(run: PredictedRun) -> list[tuple[str, str]]:
    rows = [("Measurements", f"{run.shots}, of the fit {run.shots_fitted}")]
    if run.rms_mm is not None:
        after, before = (
            ", ".join(numbers.or_words(value, _MISSING, "mm") for value in values)
            for values in (
                (run.rms_mm, run.median_mm, run.max_mm),
                (run.rms_before_mm, run.median_before_mm, run.max_before_mm),
            )
        )
        rows += [
            ("Errors (rms, median, largest)", after),
            ("Errors with nominal values", before),
            ("Errors expected, rms", numbers.or_words(run.expected_mm, _MISSING, "mm")),
            ("Standard uncertainty of the prediction, rms", numbers.or_words(run.u_mm, _MISSING, "mm")),
        ]
    if run.p_value is not None:
        rows += [
            ("χ²", numbers.or_words(run.chi2, _MISSING)),
            ("Degrees of freedom", str(run.dof)),
            ("p-value", numbers.p_value(run.p_value)),
        ]
    return rows


def _errors_table(run: PredictedRun) -> Table:
    """The largest errors first; what is unknown comes at the end, and has no number but its u."""
    ordered = sorted(run.measurements, key=lambda row: -1.0 if row.error_mm is None else -row.error_mm)
    ordered = sorted(ordered, key=lambda row: row.error_mm is None)[:_MOST_ROWS]
    columns = ["measurement", "target", "nominal", "calibrated", "expected", "u of prediction"]
    rows = []
    for row in ordered:
        missing = "unknown" if row.shot in run.unknown else "none"
        rows.append(
            row_of(
                str(row.shot),
                clipped(row.target, 24),
                numbers.or_words(row.before_mm, "—", "mm"),
                numbers.or_words(row.error_mm, missing, "mm"),
                numbers.or_words(row.expected_mm, "—", "mm"),
                numbers.significant(row.u_mm, 2, "mm"),
            )
        )
    caption = "Errors of the prediction by measurement, the largest first"
    if len(ordered) < len(run.measurements):
        caption += (
            f" ({len(ordered)} of {counted(len(run.measurements), 'measurement')}; result.json has all)"
        )
    return table_of(caption, columns, rows, "llr")


def predicted_run_picture(result: Result) -> Picture | None:
    """The errors by measurement, nominal above calibrated, and what is expected; None without any."""
    run = result.hold_out
    if not isinstance(run, PredictedRun) or run.rms_mm is None:
        return None
    rows = [row for row in run.measurements if row.error_mm is not None]
    title = "Errors of the prediction of the held-out run, measurement by measurement"
    if len(rows) > _MOST_DRAWN:
        title += f": {_MOST_DRAWN} of {len(rows)}, evenly"
        rows = [rows[i] for i in np.linspace(0, len(rows) - 1, _MOST_DRAWN).round().astype(int)]
    x = np.arange(len(rows))
    size = 5.0 if len(rows) <= 60 else 2.5
    drawn: list[tuple[str, list[float | None], str, str]] = [
        ("nominal", [row.before_mm for row in rows], "D", "muted"),
        ("calibrated", [row.error_mm for row in rows], "o", "identified"),
        ("expected", [row.expected_mm for row in rows], "_", "weak"),
    ]
    with style():
        figure = new_figure(2.6)
        axes: Axes = figure.subplots()
        for words, lengths, marker, colour in drawn:
            y = np.array(lengths, dtype=float)
            if not np.isfinite(y).any():
                continue
            edge = 1.5 if marker == "_" else 0.0
            width = size * (2.0 if marker == "_" else 1.0)
            axes.plot(x, y, marker, markersize=width, markeredgewidth=edge, color=light(colour), label=words)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_minor_formatter(lambda value, _: "")
        axes.set_ylabel("error, mm")
        axes.set_xlim(-0.7, len(rows) - 0.3)
        if len(rows) <= 60:
            axes.set_xticks(x, [str(row.shot) for row in rows])
            axes.tick_params(axis="x", labelsize=8 if len(rows) <= 25 else 5.5)
        else:
            axes.tick_params(axis="x", labelbottom=False, length=0)
        axes.set_xlabel("measurement")
        axes.grid(visible=False, axis="x")
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False, fontsize=8.5)
        svg = to_svg(figure, _RUN_PICTURE)
    return Picture(_RUN_PICTURE, title, predicted_run_alt(run), svg)
