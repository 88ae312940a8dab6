"""The misses, shot by shot."""

from __future__ import annotations

import math
from typing import Any

from ..style.blocks import Cell, row_of, table_of
from ..words import numbers
from ..words.wording import clipped

Json = dict[str, Any]

MOST_SHOTS = 60
WORST_SHOTS = 20


def shots_part(result: Json) -> Json:
    columns = [
        ("shot", "right"),
        ("target", "left"),
        ("miss", "right"),
        ("in its own σ", "right"),
        ("left out", "right"),
        ("Cook’s distance", "right"),
    ]
    shots, robust = result["shots"], result["robust"]
    weights = robust["weights"] if robust is not None and robust["converged"] else None
    outliers = set(robust["outliers"]) if weights is not None else set()
    chosen, caption = list(range(len(shots))), "Miss of every shot"
    said = (
        "A miss is what the fit leaves between beam (or probe) and target. “Left out” is the miss that "
        "the other shots predict; Cook’s distance is how far the answer moves without the shot."
    )
    if weights is not None:
        columns += [("weight", "right"), ("outlier", "left")] if outliers else [("weight", "right")]
        said += " The weight is that of the robust fit."
    told = [i for i in chosen if shots[i]["cooks"] is not None]
    heaviest = max(told, key=lambda i: float(shots[i]["cooks"]), default=None)
    if heaviest is not None:
        shot, cooks = shots[heaviest]["shot"], numbers.significant(shots[heaviest]["cooks"], 2)
        said += f" The answer hangs most on shot {shot} (Cook’s distance {cooks})."
    if len(shots) > MOST_SHOTS:
        # An outlier of the robust fit may have pulled the likelihood fit to itself.
        worst = sorted(chosen, key=lambda i: (shots[i]["shot"] not in outliers, -shots[i]["whitened"]))
        chosen = worst[:WORST_SHOTS]
        chosen += [] if heaviest is None or heaviest in chosen else [heaviest]
        caption = f"The {WORST_SHOTS} worst shots of {len(shots)}"
        caption += ", and the most influential" if len(chosen) > WORST_SHOTS else ""
        said += f" Of {len(shots)} shots the table shows the {WORST_SHOTS} worst; result.json has all."
    rows = []
    for i in chosen:
        shot = shots[i]
        cells: list[str | Cell] = [
            str(shot["shot"]),
            clipped(shot["target"], 24),
            numbers.significant(math.hypot(*shot["miss_mm"]), unit="mm"),
            numbers.significant(shot["whitened"], 2),
            numbers.or_words(shot["leave_one_out"], "not predictable", "mm"),
            numbers.or_words(shot["cooks"], "not defined"),
        ]
        if weights is not None:
            cells.append(numbers.fixed(weights[i], 2))
        if outliers:
            cells.append(Cell("yes", mark="weak") if shot["shot"] in outliers else "no")
        rows.append(row_of(*cells))
    return {"sentence": said, "table": table_of(caption, columns, rows)}
