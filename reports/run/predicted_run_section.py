"""A held-out run: its errors by measurement, with nominal values and with the estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...analysis.answer.result import Result
from ...analysis.diagnostics.predicted_run import PredictedRun
from ...words import numbers
from ...words.predicted_run_words import predicted_run_alt, predicted_run_sentences
from ...words.wording import clipped, counted
from ..style.blocks import Facts, FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import light

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PICTURE = "held_out_run"
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
        FigureBlock(_PICTURE) if predicted else None,
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
        svg = to_svg(figure, _PICTURE)
    return Picture(_PICTURE, title, predicted_run_alt(run), svg)
