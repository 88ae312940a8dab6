"""How well the model fits, by both costs."""

from __future__ import annotations

import math
from typing import Any

from ..style.blocks import Cell, Table, row_of, table_of
from ..words import numbers
from ..words.wording import clipped, label, sentence
from .view_parameters import NOT_DETERMINED

Json = dict[str, Any]

LACK_OF_FIT = 0.01  # p-value below which the misses are called larger than the noise
_NO_COST = "not defined for this cost"


def fit_part(result: Json) -> Json:
    likelihood, midpoint = result["fits"]["likelihood"], result["fits"]["midpoint"]
    separate = any(row["group"] == "noise" and not row["held"] for row in result["parameters"])
    sides = [_fit_facts(likelihood, separate)]
    if midpoint["available"]:
        sides.append(_fit_facts(midpoint, False))
    columns = [("quantity", "left"), ("beam-miss likelihood", "right"), ("midpoint cost (eq. 8)", "right")]
    rows = [row_of(name, *(side[name] for side in sides)) for name in sides[0]]
    said = _fit_verdict(likelihood, "fitted" if separate else "stated")
    if likelihood["message"]:
        said.append(sentence(likelihood["message"]))
    if not midpoint["available"]:
        said.append(f"The paper’s midpoint fit (eq. 8) is not available: {sentence(midpoint['reason'])}.")
    if midpoint["message"]:
        said.append(f"Midpoint fit: {sentence(midpoint['message'])}")
    return {
        "sentences": said,
        "table": table_of("Quality of the fit", columns[: 1 + len(sides)], rows),
        "estimates": _both_estimates(result["parameters"]),
    }


def _fit_facts(fit: Json, separate: bool) -> dict[str, str]:
    p, scale = fit["p_value"], fit["noise_scale"]
    no_p = "not defined: the noise was estimated" if separate or scale is not None else _NO_COST
    return {
        "Converged": f"{'yes' if fit['converged'] else 'NO'}: {sentence(fit['reason'])}",
        "Iterations": str(fit["iterations"]),
        "Miss before, rms": numbers.or_words(fit["rms_before_mm"], _NO_COST, "mm"),
        "Miss after, rms": numbers.or_words(fit["rms_mm"], _NO_COST, "mm"),
        "χ²": numbers.or_words(fit["chi2"], _NO_COST),
        "Degrees of freedom": _NO_COST if fit["dof"] is None else str(fit["dof"]),
        "p-value": no_p if p is None else numbers.p_value(p),
        "Noise, as a multiple of the stated": numbers.or_words(
            scale, "its factors are estimated" if separate else "taken as stated"
        ),
        "Other basins found": str(fit["other_basins"]),
    }


def _both_estimates(parameters: list[Json]) -> Table | None:
    """The offsets by both costs, where both have an estimate."""
    both = [row for row in parameters if row["group"] == "offset" and row["midpoint"] is not None]
    if not both:
        return None
    columns = [
        ("name", "left"),
        ("beam-miss likelihood", "right"),
        ("midpoint cost (eq. 8)", "right"),
        ("apart, in σ of the likelihood", "right"),
    ]
    rows = [
        row_of(
            label(row["name"]),
            numbers.estimate(row["estimate"], row["std"], row["unit"]),
            numbers.estimate(row["midpoint"], row["std"], row["unit"]),
            numbers.significant((row["midpoint"] - row["estimate"]) / row["std"], 2),
        )
        for row in both
    ]
    return table_of("Offsets by both costs", columns, rows)


def times_the_noise(fit: Json) -> str | None:
    """By what the misses of a fit, or of targets held out, are larger than explained; None where they are
    not, or where nothing can tell."""
    p, chi2, dof = fit["p_value"], fit["chi2"], fit["dof"]
    if p is None or chi2 is None or not dof or p >= LACK_OF_FIT:
        return None
    return numbers.significant(math.sqrt(chi2 / dof), 2)


def _fit_verdict(fit: Json, noise: str) -> list[str]:
    """The goodness of fit in plain words, the gravest first; against the `stated` or the `fitted` noise."""
    said = not_converged(fit)
    p, chi2, dof = fit["p_value"], fit["chi2"], fit["dof"]
    if p is None or chi2 is None or not dof:
        return said
    measure = f"χ²\u00a0{numbers.significant(chi2)} for {dof} degrees of freedom, p\u00a0{numbers.p_value(p)}"
    if times := times_the_noise(fit):
        said.append(
            f"Lack of fit: the misses are some {times} times as large as the {noise} noise explains "
            f"({measure}). The geometry, the noise or single shots are not as stated, and the intervals "
            "do not cover that error."
        )
    elif p > 0.99:
        said.append(f"The misses are smaller than the {noise} noise ({measure}): it may be overstated.")
    else:
        said.append(f"The misses are as large as the {noise} noise makes them ({measure}).")
    return said


def not_converged(fit: Json) -> list[str]:
    if fit["converged"]:
        return []
    return [
        f"The fit did not converge ({sentence(fit['reason'])}): do not use its numbers. "
        "Look at the misses below for a wrong shot, or state a better guess of target and tool."
    ]


def distances_part(rows: list[Json]) -> Table | None:
    if not rows:
        return None
    columns = [
        ("between", "left"),
        ("stated", "right"),
        ("its σ", "right"),
        ("after the fit", "right"),
        ("its σ", "right"),
    ]
    shown_rows = []
    for row in rows:
        names = f"{clipped(row['between'][0], 24)} and {clipped(row['between'][1], 24)}"
        stated = (numbers.exact(row["mm"], "mm"), numbers.exact(row["sigma_mm"], "mm"))
        if row["estimate"] is None or row["std"] is None:
            shown_rows.append(row_of(names, *stated, Cell(NOT_DETERMINED, span=2), tone="unidentifiable"))
        else:
            found = numbers.estimate(row["estimate"], row["std"], "mm")
            shown_rows.append(row_of(names, *stated, found, numbers.spread(row["std"], "mm")))
    return table_of("Distances between targets", columns, shown_rows)
