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
            )
            if (rows := [row for row in parameters if row["group"] == group])
        ],
        "unknown": unknown(result),
        "fit": _fit(result),
        "distances": _distances(result["distances"]),
        "posterior": _posterior(result),
        "shots": _shots(result["shots"]),
        "inputs": _inputs(inputs),
    }


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
    status, unit = row["status"], row["unit"]
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
    sides = [_fit_facts(fit) for fit in (likelihood, midpoint) if fit["available"]]
    columns = [("quantity", "left"), ("beam-miss likelihood", "right"), ("midpoint cost (eq. 8)", "right")]
    rows = [row_of(name, *(side[name] for side in sides)) for name in sides[0]]
    said = _fit_verdict(likelihood)
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


def _fit_facts(fit: Json) -> dict[str, str]:
    p, scale = fit["p_value"], fit["noise_scale"]
    no_p = _NO_COST if scale is None else "not defined: the noise was estimated"
    return {
        "Converged": f"{'yes' if fit['converged'] else 'NO'}: {sentence(fit['reason'])}",
        "Iterations": str(fit["iterations"]),
        "Miss before, rms": _or(fit["rms_before_mm"], _NO_COST, "mm"),
        "Miss after, rms": _or(fit["rms_mm"], _NO_COST, "mm"),
        "χ²": _or(fit["chi2"], _NO_COST),
        "Degrees of freedom": _NO_COST if fit["dof"] is None else str(fit["dof"]),
        "p-value": no_p if p is None else numbers.p_value(p),
        "Noise, as a multiple of the stated": _or(scale, "taken as stated"),
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


def _fit_verdict(fit: Json) -> list[str]:
    """The goodness of fit in plain words, the gravest first."""
    said = _not_converged(fit)
    p, chi2, dof = fit["p_value"], fit["chi2"], fit["dof"]
    if p is None or chi2 is None or not dof:
        return said
    measure = f"χ²\u00a0{numbers.significant(chi2)} for {dof} degrees of freedom, p\u00a0{numbers.p_value(p)}"
    if p < 0.01:
        times = numbers.significant(math.sqrt(chi2 / dof), 2)
        said.append(
            f"Lack of fit: the misses are some {times} times as large as the stated noise explains "
            f"({measure}). The geometry, the noise or single shots are not as stated, and the intervals "
            "do not cover that error."
        )
    elif p > 0.99:
        said.append(f"The misses are smaller than the stated noise ({measure}): it may be overstated.")
    else:
        said.append(f"The misses are as large as the stated noise makes them ({measure}).")
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
        std, unit = row["std"], row["unit"]
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
    return table_of("Posterior of offsets and tool", columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)


# ── shots ─────────────────────────────────────────────────────────────────────────────────────


def _shots(shots: list[Json]) -> Json:
    columns = [
        ("shot", "right"),
        ("target", "left"),
        ("miss", "right"),
        ("in its own σ", "right"),
        ("left out", "right"),
        ("Cook’s distance", "right"),
    ]
    listed, caption = shots, "Miss of every shot"
    said = (
        "A miss is what the fit leaves between beam (or probe) and target. “Left out” is the miss that "
        "the other shots predict; Cook’s distance is how far the answer moves without the shot."
    )
    if len(shots) > MOST_SHOTS:
        worst = sorted(range(len(shots)), key=lambda i: -shots[i]["whitened"])[:WORST_SHOTS]
        listed, caption = [shots[i] for i in worst], f"The {WORST_SHOTS} worst shots of {len(shots)}"
        said += f" Of {len(shots)} shots the table shows the {WORST_SHOTS} worst; result.json has all."
    rows = [
        row_of(
            str(shot["shot"]),
            clipped(shot["target"], 24),
            numbers.significant(math.hypot(*shot["miss_mm"]), unit="mm"),
            numbers.significant(shot["whitened"], 2),
            _or(shot["leave_one_out"], "not predictable", "mm"),
            _or(shot["cooks"], "not defined"),
        )
        for shot in listed
    ]
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
