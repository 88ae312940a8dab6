"""Second opinions: the robust fit, targets held out, the intervals by three ways."""

from __future__ import annotations

from typing import Any

from ..style.blocks import Cell, Facts, Table, row_of, table_of
from ..words import numbers
from ..words.wording import clipped, label, listed, sentence
from .view_fit import times_the_noise
from .view_parameters import NOT_DETERMINED, unit_of

Json = dict[str, Any]


def robust_part(result: Json) -> Json | None:
    """The robust fit next to the likelihood fit; None where it was not asked for."""
    robust = result["robust"]
    if robust is None:
        return None
    if not robust["converged"]:
        told = f"The robust fit did not converge ({sentence(robust['reason'])}) and is not shown."
        return {"sentences": [told], "table": None}
    if robust["loss"] == "huber":
        bend = numbers.significant(robust["tuning"])
        said = [f"Huber’s loss: a miss beyond {bend} of its own σ weighs less, the longer the less."]
    else:
        nu = numbers.exact(robust["tuning"])
        said = [f"Student’s loss with {nu} degrees of freedom: the longer a miss, the less it weighs."]
    said.append("A shot of weight 1 counts as in the likelihood fit.")
    said.append(_outliers(result["shots"], robust))
    if robust["noise_scale"] is not None:
        said.append(f"The noise is {numbers.significant(robust['noise_scale'])} times the stated.")
    if all(row["std"] is None for row in robust["parameters"]):
        said.append(
            "It has no uncertainty: a shot decides something alone, or there are as many unknowns as numbers."
        )
    else:
        said.append("Its intervals follow from the misses as they are, not from the stated noise.")
    return {"sentences": [" ".join(said)], "table": _robust_table(result["parameters"], robust)}


def _outliers(shots: list[Json], robust: Json) -> str:
    if not robust["outliers"]:
        return "No shot is too far off for chance."
    weights = {shot["shot"]: weight for shot, weight in zip(shots, robust["weights"], strict=True)}
    named = [f"{number} (weight {numbers.fixed(weights[number], 2)})" for number in robust["outliers"]]
    return f"Too far off for chance: {'shot' if len(named) == 1 else 'shots'} {listed(named)}."


def _robust_table(parameters: list[Json], robust: Json) -> Table:
    columns = [
        ("name", "left"),
        ("likelihood", "right"),
        ("robust", "right"),
        ("its 95 % interval", "right"),
        ("apart, in σ", "right"),
    ]
    fitted = {row["name"]: row for row in parameters}
    rows = []
    for row in robust["parameters"]:
        known, unit = fitted[row["name"]], unit_of(row)
        if known["group"] == "target":
            continue
        name = label(row["name"])
        if known["std"] is None or row["estimate"] is None:
            rows.append(row_of(name, Cell(NOT_DETERMINED, span=4), tone="unidentifiable"))
            continue
        std = row["std"] or known["std"]
        rows.append(
            row_of(
                name,
                numbers.estimate(known["estimate"], known["std"], unit),
                numbers.estimate(row["estimate"], std, unit),
                "none"
                if row["interval95"] is None
                else numbers.interval(tuple(row["interval95"]), std, unit),
                numbers.significant((row["estimate"] - known["estimate"]) / known["std"], 2),
            )
        )
    return table_of("Offsets and tool by both fits, apart in σ of the likelihood fit", columns, rows)


def hold_out_part(held_out: Json | None) -> Json | None:
    """How the fit does at targets that it has not seen; None where none was held out."""
    if held_out is None:
        return None
    said = [
        "Offsets and tool are fitted without these targets. Then only the place of each is fitted, to its own"
        " shots; what is left of the misses shows whether the offsets hold there."
    ]
    chi2, dof, p = held_out["chi2"], held_out["dof"], held_out["p_value"]
    if chi2 is not None and dof and p is not None:
        if times := times_the_noise(held_out):
            said.append(
                f"The misses are some {times} times as large as noise and fit explain: the offsets do not"
                " carry over to these targets as promised."
            )
        else:
            said.append("The misses are no larger than noise and fit explain: the offsets hold there too.")
    if held_out["message"]:
        said.append(f"No judgement: {sentence(held_out['message']).rstrip('.')}.")
    names = [clipped(name, 24) for name in held_out["targets"]]
    rows = [
        ("Targets", f"{len(names)}: {listed(names)}"),
        ("Shots there", str(held_out["shots"])),
        ("Shots of the fit", str(held_out["shots_fitted"])),
        ("Miss without offsets, rms", numbers.or_words(held_out["rms_before_mm"], "not available", "mm")),
        ("Miss with them, rms", numbers.or_words(held_out["rms_mm"], "not available", "mm")),
        (
            "Miss expected from noise and fit",
            numbers.or_words(held_out["expected_mm"], "not available", "mm"),
        ),
        ("χ²", numbers.or_words(chi2, "not available")),
        ("Degrees of freedom", "not available" if dof is None else str(dof)),
        ("p-value", "not available" if p is None else numbers.p_value(p)),
    ]
    return {"sentences": said, "facts": Facts(rows)}


def intervals_part(result: Json) -> Json | None:
    """The intervals by three ways, where they differ or a parameter is weak; None where there is no such."""
    stds = {row["name"]: row["std"] for row in result["parameters"]}
    told = [row for row in result["intervals"] if stds[row["name"]] is not None]
    if not told:
        return None

    def ends(row: Json, way: str, missing: str) -> str:
        if row[way] is None:
            return missing
        return numbers.interval(tuple(row[way]), stds[row["name"]], unit_of(row))

    columns = [("name", "left"), ("curvature", "right"), ("profile", "right"), ("posterior", "right")]
    rows = [
        row_of(
            label(row["name"]),
            ends(row, "linear", ""),
            ends(row, "profile", "no end found"),
            ends(row, "posterior", "not sampled"),
        )
        for row in told
    ]
    said = (
        "By the curvature at the estimate, by the profile likelihood and by the quantiles of the posterior’s"
        " draws."
    )
    if differing := [label(row["name"]) for row in told if row["differ"]]:
        said += (
            f" They differ by a tenth of their width or more for {listed(differing)}: do not rely on one"
            " alone there, the widest is the safe one."
        )
    else:
        said += " They agree."
    return {"sentence": said, "table": table_of("95 % intervals by three ways", columns, rows)}
