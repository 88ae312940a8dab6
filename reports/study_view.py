"""What a reader of a coverage study is told: its answer (`zerobeam/study/1`) as display strings.

Terminal, HTML and PDF print these and round nothing themselves. Tables are those of `view`. The mark of
an estimator says whether its intervals hold what they promise; a control is an estimator that is wrong
on purpose, so that to fail is what is asked of it.
"""

from __future__ import annotations

import math
from typing import Any

from . import numbers
from .view import cell_of, counted, facts_of, listed, row_of, table_of
from .wording import clipped, label, sentence, shown

Json = dict[str, Any]

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
BY_CHANCE = (
    "One binomial interval in twenty misses the level by chance, and the farthest of several more often."
)
# Whether a thing agrees, by (control, agrees): the mark (a role of the palette) and the words for it.
STANDING: dict[tuple[bool, bool], tuple[str, str]] = {
    (False, True): ("identified", "agrees"),
    (False, False): ("weak", "does not agree"),
    (True, False): ("held", "control: fails, as it must"),
    (True, True): ("weak", "control: passes, but must not"),
}
_NORMAL_95 = 1.959964  # half width of a 95 % interval in standard deviations
_LONGEST_NAME = 40


def study_view(answer: Json) -> Json:
    """The display strings of a whole study."""
    settings, plans = answer["settings"], answer["plans"]
    agrees = answer["agrees"]
    return {
        "title": sentence(answer["title"]),
        "subtitle": f"{settings['data_sets']} simulated data sets for each of {counted(len(plans), 'plan')},"
        f" seed {settings['seed']}",
        "verdict": {
            "key": "pass" if agrees else "weak",
            "word": "Agrees" if agrees else "Does not agree",
            "sentence": sentence(answer["headline"]),
        },
        "notes": [sentence(note) for note in answer["notes"]],
        "overview": _overview(plans, settings["levels"]),
        "by_chance": BY_CHANCE,
        "legend": {"legend": _legend(plans), "reasons": []},
        "plans": [_plan(plan, settings, i + 1) for i, plan in enumerate(plans)],
        "comparison": _comparison(plans),
        "settings": _settings(answer),
    }


def standing(part: Json) -> tuple[str, str]:
    """The mark and the words of an estimator, or of its ranks: agrees, fails, or fails as it must."""
    return STANDING[part["control"], part["agrees"]]


def determined(row: Json, control: bool) -> bool:
    """Whether a parameter has shares to print.

    One that a data set cannot tell has none, whatever the answer holds, unless a control claims to
    know it: that the truth is not in its intervals is what the control is there to show.
    """
    solved_any = bool(row["coverage"]) and all(entry["of"] for entry in row["coverage"])
    return solved_any and (control or row["status"] != "unidentifiable")


def undetermined(plan: Json) -> list[str]:
    """Names of the parameters that a data set of this plan cannot tell, by any estimator but a control."""
    names = [
        row["name"]
        for estimator in plan["estimators"]
        if not estimator["control"]
        for row in estimator["parameters"]
        if not determined(row, control=False)
    ]
    return [label(name) for name in dict.fromkeys(names)]


def percent(level: float) -> str:
    """A level of confidence as a heading: 0.95 → 95 %."""
    return f"{numbers.exact(100 * level)}{numbers.NO_BREAK}%"


def share(row: Json) -> str:
    """The share of intervals that held the truth, in per cent and without the sign."""
    return numbers.fixed(100 * row["share"], _share_decimals(row))


def share_interval(row: Json) -> str:
    """The binomial interval of such a share, `low to high` in per cent and without the sign."""
    digits = _share_decimals(row)
    return f"{numbers.fixed(100 * row['low'], digits)} to {numbers.fixed(100 * row['high'], digits)}"


def _share_decimals(row: Json) -> int:
    """By the binomial uncertainty, but no finer than the count itself: 948 of 1000 is 94.8 %."""
    std = 100 * (row["high"] - row["low"]) / (2 * _NORMAL_95)
    return min(numbers.decimals(std), max(0, math.ceil(math.log10(row["of"])) - 2))


def worst_at(estimator: Json, level: float) -> tuple[Json, Json] | None:
    """The parameter whose share at `level` is farthest from it, with its share; None if none has one.

    Measured in binomial standard deviations, since parameters may have different numbers of data sets.
    """
    found = [
        (abs(entry["share"] - level) * math.sqrt(entry["of"]), row, entry)
        for row in estimator["parameters"]
        if determined(row, estimator["control"])
        for entry in row["coverage"]
        if entry["level"] == level
    ]
    if not found:
        return None
    _, row, entry = max(found, key=lambda item: item[0])
    return row, entry


# ── all plans ─────────────────────────────────────────────────────────────────────────────────


def _overview(plans: list[Json], levels: list[float]) -> Json:
    # The standing second, so that a phone shows it without scrolling.
    columns = [("estimator", "left"), ("intervals", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for plan in plans:
        title = f"Plan {clipped(plan['name'], _LONGEST_NAME)}"
        rows.append(row_of(title, cell_of(sentence(plan["words"]), span=len(columns) - 1)))
        for estimator in plan["estimators"]:
            mark, words = standing(estimator)
            cells = [_worst_cell(estimator, level) for level in levels]
            name = clipped(estimator["name"], _LONGEST_NAME)
            rows.append(row_of(name, cell_of(words, mark=mark), *cells, tone=mark))
    return table_of(
        "Share of intervals that hold the truth, in %: the parameter farthest from each level",
        columns,
        rows,
    )


def _worst_cell(estimator: Json, level: float) -> str:
    worst = worst_at(estimator, level)
    return NOT_DETERMINED if worst is None else f"{label(worst[0]['name'], 12)}: {share(worst[1])}"


def _legend(plans: list[Json]) -> list[Json]:
    meaning = {
        (False, True): "the intervals hold the truth as often as they promise, within the binomial error",
        (False, False): "they hold it more or less often, beyond the binomial error",
        (True, False): "wrong on purpose, and seen to be wrong: this study can find such a fault",
        (True, True): "wrong on purpose, and not seen to be: this study could not find such a fault",
    }
    parts = [part for plan in plans for part in (*plan["estimators"], *plan["sbc"])]
    present = {(part["control"], part["agrees"]) for part in parts}
    entries = [
        {"status": STANDING[key][0], "word": STANDING[key][1], "text": text}
        for key, text in meaning.items()
        if key in present
    ]
    if any(
        not determined(row, part["control"])
        for part in parts
        for row in part["parameters"]
        if "coverage" in row
    ):
        text = "a data set of this plan cannot tell the parameter, so there is no interval to judge"
        entries.append({"status": "unidentifiable", "word": NOT_DETERMINED, "text": text})
    return entries


# ── one plan ──────────────────────────────────────────────────────────────────────────────────


def _plan(plan: Json, settings: Json, number: int) -> Json:
    facts = [
        ("Plan", sentence(plan["words"])),
        ("Robot", clipped(plan["robot"])),
        ("Shots", str(plan["shots"])),
        ("Noise", ", ".join(_noise(key, value) for key, value in plan["noise"].items())),
        ("Data sets", str(plan["data_sets"])),
        ("Truths not met", f"{plan['failed']} (others drawn in their place)" if plan["failed"] else "none"),
    ]
    return {
        "title": f"Plan {clipped(plan['name'], _LONGEST_NAME)}",
        "facts": facts_of(facts),
        "estimators": {"legend": [], "reasons": _sentences(plan["estimators"])},
        "coverage_figure": f"coverage_{number}",
        "coverage": _coverage_table(plan, settings["levels"]),
        "accuracy": _accuracy_table(plan),
        "ranks_figure": f"ranks_{number}",
        "ranks": {"legend": [], "reasons": _sentences(plan["sbc"])},
        "powers": _powers(plan["sbc"]),
        "uniformity": _ranks_table(plan["sbc"], settings["bins"]),
    }


def _noise(key: str, value: float) -> str:
    name, _, unit = key.rpartition("_")
    return f"{shown(name)} {numbers.exact(value, unit)}"


def _sentences(parts: list[Json]) -> list[Json]:
    rows = []
    for part in parts:
        mark, words = standing(part)
        name = clipped(part["name"], _LONGEST_NAME)
        rows.append({"names": f"{name}: {words}.", "status": mark, "text": sentence(part["sentence"])})
    return rows


def _powers(parts: list[Json]) -> str:
    """What the uniformity test could have found, said once where it is the same for all."""
    said: dict[str, list[str]] = {}
    for part in parts:
        if part["power"]:
            said.setdefault(sentence(part["power"]).rstrip("."), []).append(
                clipped(part["name"], _LONGEST_NAME)
            )
    if len(said) == 1:
        return f"Power of the test: {next(iter(said))}."
    return " ".join(f"Power of the test for {listed(names)}: {text}." for text, names in said.items())


def _coverage_table(plan: Json, levels: list[float]) -> Json:
    columns = [("parameter", "left"), *((percent(level), "right") for level in levels)]
    rows = []
    for estimator in plan["estimators"]:
        rows.append(_group(estimator, len(levels)))
        for row in estimator["parameters"]:
            if not determined(row, estimator["control"]):
                words = cell_of(NOT_DETERMINED, span=len(levels))
                rows.append(row_of(label(row["name"]), words, tone="unidentifiable"))
                continue
            entries = {entry["level"]: entry for entry in row["coverage"]}
            cells = [_share_cell(entries.get(level), estimator["control"]) for level in levels]
            tone = "weak" if any(cell["mark"] for cell in cells) else ""
            rows.append(row_of(label(row["name"]), *cells, tone=tone))
    return table_of(
        "Share of intervals that hold the truth, in %, with its 95 % binomial interval", columns, rows
    )


def _share_cell(entry: Json | None, control: bool) -> Json:
    """A share with its interval, marked where it should agree and does not."""
    if entry is None:
        return cell_of(NOT_GIVEN)
    return cell_of(
        f"{share(entry)} ({share_interval(entry)})", mark="" if control or entry["agrees"] else "weak"
    )


def _group(part: Json, span: int) -> Json:
    """The row that heads an estimator's parameters."""
    mark, words = standing(part)
    # A name beside its own mark and words; what it does is said by the words of the estimator.
    about = f"{sentence(part['words'])} ({words})" if "words" in part else words
    return row_of(clipped(part["name"], _LONGEST_NAME), cell_of(about, span=span), tone=mark)


def _accuracy_table(plan: Json) -> Json:
    columns = [
        ("parameter", "left"),
        ("bias", "right"),
        ("its standard error", "right"),
        ("rmse", "right"),
        ("predicted std", "right"),
    ]
    rows = []
    for estimator in plan["estimators"]:
        rows.append(_group(estimator, len(columns) - 1))
        rows.extend(_accuracy_row(row, plan) for row in estimator["parameters"])
    return table_of("Bias and root mean square error, next to what was predicted", columns, rows)


def _accuracy_row(row: Json, plan: Json) -> Json:
    if not has_errors(row):
        words = cell_of(NOT_DETERMINED, span=4)
        return row_of(label(row["name"]), words, tone="unidentifiable")
    unit, mcse, rmse = row["unit"], row["bias_mcse"], row["rmse"]
    about = rmse / math.sqrt(2 * solved(plan))
    predicted = row["predicted_std"]
    return row_of(
        label(row["name"]),
        numbers.estimate(row["bias"], mcse, unit),
        numbers.spread(mcse, unit),
        numbers.estimate(rmse, about, unit),
        NOT_GIVEN if predicted is None else numbers.estimate(predicted, about, unit),
    )


def has_errors(row: Json) -> bool:
    """Whether bias and rmse of a parameter mean anything."""
    return (
        row["status"] != "unidentifiable"
        and row["bias"] is not None
        and bool(row["bias_mcse"] and row["rmse"])
    )


def solved(plan: Json) -> int:
    """The number of data sets, on which bias and rmse rest."""
    return max(1, int(plan["data_sets"]))


def _ranks_table(parts: list[Json], bins: int) -> Json | None:
    rows = []
    for part in parts:
        rows.append(_group(part, 2))
        for row in part["parameters"]:
            chi2, p = row["chi2"], row["p_value"]
            if chi2 is None or p is None:
                words = cell_of(NOT_DETERMINED, span=2)
                rows.append(row_of(label(row["name"]), words, tone="unidentifiable"))
            else:
                rows.append(row_of(label(row["name"]), numbers.significant(chi2), numbers.p_value(p)))
    columns = [("parameter", "left"), (f"χ² ({bins - 1} degrees of freedom)", "right"), ("p-value", "right")]
    return table_of("Are the ranks uniform?", columns, rows) if rows else None


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


def rmse_ratios(plan: Json) -> list[tuple[Json, Json, float]] | None:
    """Midpoint row, likelihood row and the ratio of their rmse for each parameter that both tell.

    None if the plan lacks one of the two estimators.
    """
    estimators = {estimator["name"]: estimator for estimator in plan["estimators"]}
    if "midpoint" not in estimators or "likelihood" not in estimators:
        return None
    likelihood = {row["name"]: row for row in estimators["likelihood"]["parameters"]}
    pairs = [(row, likelihood.get(row["name"])) for row in estimators["midpoint"]["parameters"]]
    return [
        (midpoint, other, midpoint["rmse"] / other["rmse"])
        for midpoint, other in pairs
        if other is not None and has_errors(midpoint) and has_errors(other)
    ]


def ratio_std(ratio: float, plan: Json) -> float:
    """An upper bound for the standard error of such a ratio.

    Each rmse of n data sets has the relative error 1/√(2n); the two share their data and are
    correlated, so that the error of the ratio is at most √2 times that.
    """
    return ratio / math.sqrt(solved(plan))


def _comparison(plans: list[Json]) -> Json | None:
    found = [(plan, ratios) for plan in plans if (ratios := rmse_ratios(plan))]
    if not found:
        return None
    parts = []
    for plan, ratios in found:
        low, high = min(r for *_, r in ratios), max(r for *_, r in ratios)
        told = numbers.interval((low, high), ratio_std(high, plan))
        parts.append(f"{told} times for the plan {clipped(plan['name'], _LONGEST_NAME)}")
    return {
        "sentence": "The rmse of the midpoint fit (eq. 8) as a multiple of the likelihood fit’s, from the"
        f" same data: {'; '.join(parts)}. Above 1 the midpoint fit is the worse."
    }


def _settings(answer: Json) -> list[Json]:
    settings = answer["settings"]
    facts = [
        ("Study", shown(answer["study"])),
        ("Data sets for each plan", str(settings["data_sets"])),
        ("Seed", str(settings["seed"])),
        ("Levels", ", ".join(percent(level) for level in settings["levels"])),
        ("Draws behind each rank", str(settings["draws"])),
        ("Bins of the rank histograms", str(settings["bins"])),
        ("Posterior", sentence(str(settings["posterior"]))),
        ("Time", f"{numbers.significant(answer['seconds'], 2)}{numbers.NO_BREAK}s"),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer["versions"].items())),
    ]
    return facts_of(facts)
