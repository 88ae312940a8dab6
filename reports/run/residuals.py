"""The residuals, measurement by measurement."""

from __future__ import annotations

import math

from ...analysis.result import Result
from ..style.blocks import Cell, FigureBlock, Paragraph, Section, row_of, section_of, table_of
from ..words import numbers
from ..words.wording import clipped

MOST_SHOTS = 60
WORST_SHOTS = 20


def residuals_section(result: Result) -> Section:
    """The section of a report; of many measurements the table has the worst."""
    columns = [
        ("measurement", "right"),
        ("target", "left"),
        ("residual", "right"),
        ("normalised", "right"),
        ("leave-one-out", "right"),
        ("Cook’s distance", "right"),
    ]
    shots, robust = result.shots, result.robust
    weights = robust.weights if robust is not None and robust.converged else None
    outliers = set(robust.outliers) if robust is not None and weights is not None else set()
    chosen, caption = list(range(len(shots))), "Residual of every measurement"
    said = (
        "A residual is what the fit leaves between beam (or probe) and target; normalised, it is divided"
        " by its standard deviation. The leave-one-out residual is that from the fit to the other"
        " measurements; Cook’s distance is how far the estimates move without the measurement."
    )
    if weights is not None:
        columns += [("weight", "right"), ("outlier", "left")] if outliers else [("weight", "right")]
        said += " The weight is that of the robust fit."
    influential = [(shot.cooks, i) for i, shot in enumerate(shots) if shot.cooks is not None]
    heaviest = max(influential, key=lambda own: own[0])[1] if influential else None
    if heaviest is not None:
        cooks = numbers.or_words(shots[heaviest].cooks, "not defined")
        said += f" Most influential measurement: {shots[heaviest].shot} (Cook’s distance {cooks})."
    if len(shots) > MOST_SHOTS:
        # An outlier of the robust fit may have pulled the likelihood fit to itself.
        worst = sorted(chosen, key=lambda i: (shots[i].shot not in outliers, -shots[i].whitened))
        chosen = worst[:WORST_SHOTS]
        chosen += [] if heaviest is None or heaviest in chosen else [heaviest]
        caption = f"The {WORST_SHOTS} largest residuals of {len(shots)}"
        caption += ", and the most influential measurement" if len(chosen) > WORST_SHOTS else ""
        said += f" Of {len(shots)} measurements the table shows the {WORST_SHOTS} worst; result.json has all."
    rows = []
    for i in chosen:
        shot = shots[i]
        cells: list[str | Cell] = [
            str(shot.shot),
            clipped(shot.target, 24),
            numbers.significant(math.hypot(*shot.miss_mm), unit="mm"),
            numbers.significant(shot.whitened, 2),
            numbers.or_words(shot.leave_one_out, "not predictable", "mm"),
            numbers.or_words(shot.cooks, "not defined"),
        ]
        if weights is not None:
            cells.append(numbers.fixed(weights[i], 2))
        if outliers:
            cells.append(Cell("yes", mark="weak") if shot.shot in outliers else "no")
        rows.append(row_of(*cells))
    return section_of("Residuals", Paragraph(said), FigureBlock("misses"), table_of(caption, columns, rows))
