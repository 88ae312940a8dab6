"""What a reader is told: `result.json` turned into the display strings that HTML and PDF both print.

Every number is rounded here, by `numbers`, so that the two reports cannot differ. A table is
{caption, columns [{text, align}], rows [{tone, cells [{text, span, mark}]}]}: `tone` is the status
that colours a row, `mark` the status whose shape stands in a cell.
"""

from __future__ import annotations

import json
import math
from typing import Any

from . import numbers
from .wording import clipped, label, sentence, shown

Json = dict[str, Any]

NOT_DETERMINED = "not determined by these data"
_NO_COST = "not defined for this cost"
MOST_SHOTS = 60
WORST_SHOTS = 20
MOST_TERMS = 6

STATUS_WORDS = {
    "identified": "identified",
    "weak": "weak",
    "unidentifiable": "unidentifiable",
    "held": "held",
}
VERDICT_WORDS = {"pass": "Pass", "weak": "Weak", "degenerate": "Degenerate"}


def view(result: Json) -> Json:
    """The display strings of a whole report, from the dict of a `result.json`."""
    parameters = result["parameters"]
    offsets = [row for row in parameters if row["group"] == "offset"]
    inputs = result["inputs"]
    return {
        "title": f"Joint offsets of {clipped(inputs['robot'])}",
        "subtitle": f"from {counted(inputs['shots'], 'shot')} in {clipped(inputs['run'], 60)}",
        "verdict": {
            "key": result["verdict"],
            "word": VERDICT_WORDS[result["verdict"]],
            "sentence": sentence(result["headline"]),
        },
        "notes": _not_converged(result["fits"]["likelihood"]) + [sentence(note) for note in result["notes"]],
        "offsets": _parameter_table("Joint offsets, to be added to the recorded joint positions", offsets),
        "legend": legend(parameters, inputs["header"]),
        "reasons": reasons(parameters),
        "others": [
            _parameter_table(caption, rows)
            for caption, group in (
                ("Targets in the base frame", "target"),
                ("Tool in the flange frame", "tool"),
                ("Noise, as a multiple of the stated", "noise"),
            )
            if (rows := [row for row in parameters if row["group"] == group])
        ],
        "unknown": unknown(result),
        "fit": _fit(result),
        "distances": _distances(result["distances"]),
        "robust": _robust(result),
        "hold_out": _hold_out(result["hold_out"]),
        "posterior": _posterior(result),
        "intervals": _intervals(result),
        "shots": _shots(result),
        "inputs": _inputs(inputs),
    }


def unit_of(row: Json) -> str:
    """What follows a number of this parameter; a noise factor is so many times the stated noise."""
    return "times" if row["unit"] == "1" else str(row["unit"])


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def cell_of(text: str, span: int = 1, mark: str = "") -> Json:
    return {"text": text, "span": span, "mark": mark}


def table_of(caption: str, columns: list[tuple[str, str]], rows: list[Json]) -> Json:
    heads = [{"text": text, "align": align} for text, align in columns]
    return {"caption": caption, "columns": heads, "rows": rows}


def row_of(*cells: str | Json, tone: str = "") -> Json:
    return {"tone": tone, "cells": [cell if isinstance(cell, dict) else cell_of(cell) for cell in cells]}


# ── parameters ────────────────────────────────────────────────────────────────────────────────


def _parameter_table(caption: str, rows: list[Json]) -> Json:
    columns = [
        ("name", "left"),
        ("estimate", "right"),
        ("95 % interval", "right"),
        ("status", "left"),
    ]
    return table_of(caption, columns, [_parameter_row(row) for row in rows])


def _parameter_row(row: Json) -> Json:
    """One parameter. Without an estimate there is no number in its row that could be taken for one."""
    status, unit = row["status"], unit_of(row)
    name, word = label(row["name"]), cell_of(STATUS_WORDS[status], mark=status)
    if status == "unidentifiable":
        return row_of(name, cell_of(NOT_DETERMINED, span=2), word, tone=status)
    if status == "held":
        return row_of(
            name, cell_of(f"held at {numbers.exact(row['estimate'], unit)}", span=2), word, tone=status
        )
    estimate = numbers.estimate(row["estimate"], row["std"], unit)
    interval = numbers.interval(tuple(row["interval95"]), row["std"], unit)
    return row_of(name, estimate, interval, word, tone=status)


def legend(parameters: list[Json], header: Json) -> list[Json]:
    """What each status that occurs means, in words."""
    tolerance = header.get("tolerance")
    stated = []
    if isinstance(tolerance, dict):
        for key, unit in (("offset_deg", "deg"), ("length_mm", "mm")):
            if isinstance(tolerance.get(key), int | float):
                stated.append(numbers.exact(float(tolerance[key]), unit))
    within = f"the tolerance ({', '.join(stated)})" if stated else "the tolerance"
    meaning = {
        "identified": f"the data alone tell it to a standard deviation within {within}",
        "weak": f"the data tell it, but to a standard deviation beyond {within}",
        "unidentifiable": "the data say less about it than was known before; it has no estimate",
        "held": "not estimated; the reason is stated below",
    }
    present = {row["status"] for row in parameters}
    return [
        {"status": key, "word": STATUS_WORDS[key], "text": text}
        for key, text in meaning.items()
        if key in present
    ]


def reasons(parameters: list[Json]) -> list[Json]:
    """Why parameters are held, weak or without an answer, where the analysis says so; one reason once."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for row in parameters:
        if row["reason"]:
            grouped.setdefault((row["status"], sentence(row["reason"])), []).append(label(row["name"]))
    rows = []
    for (status, text), names in grouped.items():
        lead = listed(names)
        # Most reasons begin with the name that they are about; it is not said twice.
        repeated = text.startswith(f"{lead} ")
        text = text.removeprefix(f"{lead} ")
        rows.append({"names": lead if repeated else f"{lead}:", "status": status, "text": text})
    return rows


# ── what cannot be known ──────────────────────────────────────────────────────────────────────


def unknown(result: Json) -> Json:
    untold = [label(row["name"]) for row in result["parameters"] if row["status"] == "unidentifiable"]
    weak = [label(row["name"]) for row in result["parameters"] if row["status"] == "weak"]
    facts = result["identifiability"]
    items = [direction_words(direction) for direction in facts["null_space"]]
    if untold:
        verb = "is" if len(untold) == 1 else "are"
        said = f"{listed(untold)} {verb} {NOT_DETERMINED}. No value is given, since any would be made up."
    elif items:
        said = "Every parameter that was not held has an estimate, but some combinations are poorly told."
    else:
        said = "Nothing that was asked for: every parameter that was not held is told by the data."
    if weak:
        said += f" Told only weakly, beyond the tolerance: {listed(weak)}."
    condition = facts["condition"]
    told = f"{facts['rank']} of {facts['size']} (whitened, scaled by the priors)"
    told += "; singular, so no condition number" if condition is None else ""
    rows = [("Rank of the Jacobian", told)]
    if condition is not None:
        rows.append(("Condition number", numbers.significant(condition)))
    indices = {name: value for name, value in facts["observability"].items() if value is not None}
    told = ", ".join(f"{shown(name)}\u00a0{numbers.significant(value)}" for name, value in indices.items())
    missing = [shown(name) for name in facts["observability"] if name not in indices]
    if missing:
        told += f"{'; ' if told else ''}{listed(missing)} not defined: the matrix is singular"
    if told:
        rows.append(("Observability indices", told))
    return {"sentence": said, "items": items, "facts": facts_of(rows)}


def advice_words(advice: Json) -> str:
    """The change of a plan that helps most, in a sentence."""
    what = "one more shot" if advice["add"] else "in its place"
    return (
        f"The single change that helps most: posture {advice['posture']} with joint {advice['joint']} turned"
        f" by {numbers.exact(advice['change_deg'], advice['unit'])}, as {what}: the worst standard"
        f" deviation falls from {numbers.spread(advice['worst_std_before'], advice['unit'])}"
        f" to {numbers.spread(advice['worst_std_after'], advice['unit'])}."
    )


def over_target_words(over: Json) -> str:
    """What becomes of a plan where its target stands elsewhere, in a sentence."""
    name, worst = max(over["worst_std"].items(), key=lambda item: float(item[1]))
    return (
        f"With the target anywhere within its stated sigma ({over['draws']} draws), {over['hit']:.0%} of the"
        f" shots hit and the worst is {label(name)} at {numbers.spread(worst)}."
    )


def direction_words(direction: Json) -> Json:
    weights = sorted(direction["combination"].items(), key=lambda item: -abs(item[1]))
    terms = [
        ("" if i == 0 and weight > 0 else "+ " if weight > 0 else f"{numbers.MINUS} ")
        + ("" if abs(weight) == 1 else f"{numbers.significant(abs(weight), 2)}\u00a0")
        + label(name, 24)
        for i, (name, weight) in enumerate(weights[:MOST_TERMS])
    ]
    more = len(weights) - MOST_TERMS
    return {
        "kind": direction_kind(direction),
        "combination": " ".join(terms) + (f" and {more} smaller" if more > 0 else ""),
        "reason": sentence(direction["reason"]),
        "remedy": sentence(direction["remedy"]),
    }


def direction_kind(direction: Json) -> str:
    """How badly the data tell a direction, in words."""
    if direction["kind"] == "exact":
        return "exact: no number of such shots tells it"
    told = direction["data_std"]
    if told is None or told >= 1:
        return "lost in the noise: the data say less than was known before"
    share = numbers.significant(told, 2)
    return f"blurred by the noise: the data narrow it only to {share} of what was known before"


def listed(names: list[str], most: int = 8) -> str:
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


# ── how well the model fits ───────────────────────────────────────────────────────────────────


def _fit(result: Json) -> Json:
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
        "Miss before, rms": _or(fit["rms_before_mm"], _NO_COST, "mm"),
        "Miss after, rms": _or(fit["rms_mm"], _NO_COST, "mm"),
        "χ²": _or(fit["chi2"], _NO_COST),
        "Degrees of freedom": _NO_COST if fit["dof"] is None else str(fit["dof"]),
        "p-value": no_p if p is None else numbers.p_value(p),
        "Noise, as a multiple of the stated": _or(
            scale, "its factors are estimated" if separate else "taken as stated"
        ),
        "Other basins found": str(fit["other_basins"]),
    }


def _both_estimates(parameters: list[Json]) -> Json | None:
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


def _fit_verdict(fit: Json, noise: str) -> list[str]:
    """The goodness of fit in plain words, the gravest first; against the `stated` or the `fitted` noise."""
    said = _not_converged(fit)
    p, chi2, dof = fit["p_value"], fit["chi2"], fit["dof"]
    if p is None or chi2 is None or not dof:
        return said
    measure = f"χ²\u00a0{numbers.significant(chi2)} for {dof} degrees of freedom, p\u00a0{numbers.p_value(p)}"
    if p < 0.01:
        times = numbers.significant(math.sqrt(chi2 / dof), 2)
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


def _not_converged(fit: Json) -> list[str]:
    if fit["converged"]:
        return []
    return [
        f"The fit did not converge ({sentence(fit['reason'])}): do not use its numbers. "
        "Look at the misses below for a wrong shot, or state a better guess of target and tool."
    ]


def _or(value: float | None, reason: str, unit: str = "") -> str:
    return reason if value is None else numbers.significant(value, unit=unit)


def _distances(rows: list[Json]) -> Json | None:
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
            shown_rows.append(row_of(names, *stated, cell_of(NOT_DETERMINED, span=2), tone="unidentifiable"))
        else:
            found = numbers.estimate(row["estimate"], row["std"], "mm")
            shown_rows.append(row_of(names, *stated, found, numbers.spread(row["std"], "mm")))
    return table_of("Distances between targets", columns, shown_rows)


# ── a second opinion ──────────────────────────────────────────────────────────────────────────


def _robust(result: Json) -> Json | None:
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


def _robust_table(parameters: list[Json], robust: Json) -> Json:
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
            rows.append(row_of(name, cell_of(NOT_DETERMINED, span=4), tone="unidentifiable"))
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


def _hold_out(held_out: Json | None) -> Json | None:
    """How the fit does at targets that it has not seen; None where none was held out."""
    if held_out is None:
        return None
    said = [
        "Offsets and tool are fitted without these targets. Then only the place of each is fitted, to its own"
        " shots; what is left of the misses shows whether the offsets hold there."
    ]
    chi2, dof, p = held_out["chi2"], held_out["dof"], held_out["p_value"]
    if chi2 is not None and dof and p is not None:
        if p < 0.01:
            times = numbers.significant(math.sqrt(chi2 / dof), 2)
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
        ("Miss without offsets, rms", _or(held_out["rms_before_mm"], "not available", "mm")),
        ("Miss with them, rms", _or(held_out["rms_mm"], "not available", "mm")),
        ("χ²", _or(chi2, "not available")),
        ("Degrees of freedom", "not available" if dof is None else str(dof)),
        ("p-value", "not available" if p is None else numbers.p_value(p)),
    ]
    return {"sentences": said, "facts": facts_of(rows)}


def _intervals(result: Json) -> Json | None:
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


# ── posterior ─────────────────────────────────────────────────────────────────────────────────


def _posterior(result: Json) -> Json:
    posterior = result["posterior"]
    facts = [
        ("Draws", str(posterior["draws"])),
        ("Ensembles", f"{posterior['ensembles']} of {counted(posterior['walkers'], 'walker')}"),
        ("Smallest effective sample size", _or(posterior["ess_min"], "not available")),
        ("Largest rank-normalised R-hat", _ratio(posterior["rhat_max"])),
        ("Acceptance", _or(posterior["acceptance"], "not available", "")),
        ("Time", f"{numbers.significant(posterior['seconds'], 2)}\u00a0s"),
    ]
    said = sentence(posterior["message"])
    if not posterior["converged"]:
        said = f"The posterior has not converged and is not shown. {said}"
    return {
        "converged": posterior["converged"],
        "sentence": said,
        "facts": facts_of(facts),
        "table": _posterior_table(result),
    }


def _posterior_table(result: Json) -> Json | None:
    posterior = result["posterior"]
    if not posterior["converged"] or posterior["parameters"] is None:
        return None
    noise = any(row["group"] == "noise" for row in result["parameters"])
    untold = {row["name"] for row in result["parameters"] if row["status"] == "unidentifiable"}
    targets = {row["name"] for row in result["parameters"] if row["group"] == "target"}
    columns = [
        ("name", "left"),
        ("mean", "right"),
        ("std", "right"),
        ("2.5 % to 97.5 %", "right"),
        ("ESS bulk, tail", "right"),
        ("R-hat", "right"),
    ]
    rows = []
    for row in posterior["parameters"]:
        if row["name"] in targets:
            continue
        if row["source"] == "prior" or row["name"] in untold:
            told = "drawn from the prior: the data have no say"
            rows.append(row_of(label(row["name"]), cell_of(told, span=5), tone="unidentifiable"))
            continue
        std, unit = row["std"], unit_of(row)
        rows.append(
            row_of(
                label(row["name"]),
                numbers.estimate(row["mean"], std, unit),
                numbers.spread(std, unit),
                numbers.interval((row["q2_5"], row["q97_5"]), std, unit),
                f"{row['ess_bulk']:.0f}, {row['ess_tail']:.0f}",
                _ratio(row["rhat"]),
            )
        )
    caption = f"Posterior of offsets{', tool and noise' if noise else ' and tool'}"
    return table_of(caption, columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)


# ── shots ─────────────────────────────────────────────────────────────────────────────────────


def _shots(result: Json) -> Json:
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
    if len(shots) > MOST_SHOTS:
        # An outlier of the robust fit may have pulled the likelihood fit to itself.
        worst = sorted(chosen, key=lambda i: (shots[i]["shot"] not in outliers, -shots[i]["whitened"]))
        chosen, caption = worst[:WORST_SHOTS], f"The {WORST_SHOTS} worst shots of {len(shots)}"
        said += f" Of {len(shots)} shots the table shows the {WORST_SHOTS} worst; result.json has all."
    rows = []
    for i in chosen:
        shot = shots[i]
        cells: list[str | Json] = [
            str(shot["shot"]),
            clipped(shot["target"], 24),
            numbers.significant(math.hypot(*shot["miss_mm"]), unit="mm"),
            numbers.significant(shot["whitened"], 2),
            _or(shot["leave_one_out"], "not predictable", "mm"),
            _or(shot["cooks"], "not defined"),
        ]
        if weights is not None:
            cells.append(numbers.fixed(weights[i], 2))
        if outliers:
            cells.append(cell_of("yes", mark="weak") if shot["shot"] in outliers else "no")
        rows.append(row_of(*cells))
    return {"sentence": said, "table": table_of(caption, columns, rows)}


# ── inputs ────────────────────────────────────────────────────────────────────────────────────


def _inputs(inputs: Json) -> Json:
    header = dict(inputs["header"])
    provenance = header.pop("provenance", None) or {}
    targets = [clipped(name, 24) for name in inputs["targets"]]
    facts = [
        ("Run", shown(inputs["run"])),
        ("SHA-256 of the run", inputs["sha256"]),
        ("Robot", shown(inputs["robot"])),
        ("Shots", str(inputs["shots"])),
        ("Targets", f"{len(targets)}: {listed(targets)}" if targets else "none"),
        ("Seed", str(inputs["seed"])),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in inputs["versions"].items())),
    ]
    return {
        "facts": facts_of(facts),
        "provenance": facts_of(_flat(provenance)),
        "header": facts_of(_flat(header)),
    }


def facts_of(rows: list[tuple[str, str]]) -> list[Json]:
    return [{"name": name, "text": text} for name, text in rows]


def _flat(value: object, path: str = "") -> list[tuple[str, str]]:
    """Nested settings as rows `tool.kind` → `laser`, as they stood in the file."""
    if isinstance(value, dict) and value:
        return [
            row for key, item in value.items() for row in _flat(item, f"{path}.{key}" if path else str(key))
        ]
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return [(clipped(path, 60), shown(text))] if path else []
